"""Issue 60, "must show": walk at 0.5 m/s up and down a step of 4 or 8 cm; stand up from a crouch of 0.25 m.

hugwbc evaluate behaviours --behaviour ground.py:over --scene step4.yaml --episodes 20 --controller learned
hugwbc evaluate behaviours --behaviour ground.py:rise --scene empty.yaml --hand-payload 4 --episodes 20 ...
"""

from hugwbc.behaviours import reach, stand, walk_to


def over(view):
    view = yield from walk_to(view, (4.6, 0.0), 0.0, speed=0.5, tolerance=0.3)
    return view


def rise(view):
    view = yield from reach(view, left=(0.35, 0.25, 0.2), right=(0.35, -0.25, 0.2), tolerance=0.3)
    view = yield from stand(view, 4.0, h=-0.25)
    return (yield from stand(view, 4.0))
