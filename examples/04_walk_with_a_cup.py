"""Take a cup from a table and walk with it: the hand keeps its place in the heading frame, carried along by the body.

An H1 has no fingers: an idealised gripper holds the cup.

    python examples/04_walk_with_a_cup.py --show
"""

import numpy as np

from hugwbc import load_robot
from hugwbc.behaviours import BehaviourSource, Course, Grip, View, grip, lift, reach, walk_to
from hugwbc.runtime import Simulation, UpperBodySource, load_controller
from hugwbc.sim.scenes import Cylinder, Scene, Table
from hugwbc.viz.show import run_script, watch

TABLE = Table(name="table", position=(0.65, -0.2), size=(0.4, 0.6), height=0.9)
CUP = Cylinder(name="cup", on="table", position=(-0.15, 0.0), radius=0.035, height=0.1, mass=0.2, colour="#b5533c")
SCENE = Scene((TABLE, CUP))
BEHIND = (-0.4, 0.0)  # [m], where the robot walks to


def fetch(view: View) -> Course:
    """Take the cup, and walk back with it."""
    view = yield from reach(view, right=(-0.04, 0.0, 0.2), frame="cup")
    view = yield from reach(view, right=(-0.02, 0.0, 0.08), frame="cup", speed=0.1)
    view = yield from grip(view, Grip("right", "cup"))
    view = yield from lift(view, "cup", 0.05)
    return (yield from walk_to(view, BEHIND, 0.0, speed=0.2))


def main(duration: float = 18.0, show: bool = False) -> None:
    """Take it and walk.

    Args:
        duration: how long to run [s].
        show: show the robot live in the browser.
    """
    source, simulation = BehaviourSource(fetch), Simulation(scene=SCENE)
    trace = watch(
        load_controller("qp"),
        source,
        simulation,
        UpperBodySource(load_robot()),
        duration=duration,
        show=show,
        replay="out/04.html",
    )
    cup = trace.object_pose[:, SCENE.body_names.index("cup")]
    tilt = np.degrees(np.arccos(1.0 - 2.0 * (cup[:, 4] ** 2 + cup[:, 5] ** 2)))
    rise, way = cup[:, 2].max() - cup[0, 2], np.hypot(*(cup[-1, :2] - cup[0, :2]))
    print(f"The cup rose by {100 * rise:.0f} cm, moved by {way:.2f} m, and tilted by {tilt.max():.0f} degrees at most.")
    print(f"The robot {trace.fate}; fetching the cup: {source.ending}.")


if __name__ == "__main__":
    run_script(main)
