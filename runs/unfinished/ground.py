"""Issue 60, "must show": walk at 0.5 m/s up and down a step of 4 or 8 cm; stand up from a crouch of 0.25 m.

hugwbc evaluate behaviours --behaviour ground.py:over --scene ground.py:step4 --episodes 20 --controller learned
hugwbc evaluate behaviours --behaviour ground.py:rise --scene ground.py:empty --hand-payload 4 --episodes 20 ...
"""

from hugwbc.behaviours import reach, stand, walk_to
from hugwbc.sim import Scene
from hugwbc.sim.scenes import Step
from hugwbc.sim.scenes.varied import Uniform


def _step(height):
    # Where it begins varies, and so does the phase in which a foot meets it.
    return Scene((Step(name="step", position=(Uniform(2.2, 2.8), 0.0), size=(2.0, 3.0, height)),))


step4, step8 = _step(0.04), _step(0.08)
empty = Scene((Step(name="far", position=(9.0, 9.0), size=(0.2, 0.2, 0.2)),))


def over(view):
    view = yield from walk_to(view, (4.6, 0.0), 0.0, speed=0.5, tolerance=0.3)
    return view


def rise(view):
    view = yield from reach(view, left=(0.35, 0.25, 0.2), right=(0.35, -0.25, 0.2), tolerance=0.3)
    view = yield from stand(view, 4.0, h=-0.25)
    return (yield from stand(view, 4.0))
