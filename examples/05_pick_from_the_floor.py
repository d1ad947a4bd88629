"""Pick up a can whose top is half a metre above the floor: the arms alone cannot, so h, p and w help.

The same behaviour without and with `whole_body`. The commands that hand IK then chooses would suit any controller. An
idealised gripper holds the can. The replay shows both attempts side by side.

    python examples/05_pick_from_the_floor.py --show
"""

import dataclasses

from hugwbc import load_robot
from hugwbc.behaviours import BehaviourSource, Course, Grip, View, grip, reach
from hugwbc.runtime import Simulation, UpperBodySource, load_controller
from hugwbc.sim.scenes import Cylinder, Scene
from hugwbc.viz.show import keep_replay, run_script, watch


def pick(view: View, above: float, whole_body: bool) -> Course:
    """Take the can by its top, `above` its middle [m], and lift it to the side of the pelvis."""
    top = (-0.02, 0.0, above + 0.04)
    view = yield from reach(view, right=top, frame="can", whole_body=whole_body, timeout=4.0)
    view = yield from grip(view, Grip("right", "can"))
    return (yield from reach(view, right=(0.35, -0.25, 0.0), tolerance=0.1))


def main(height: float = 0.5, duration: float = 9.0, show: bool = False) -> None:
    """Try it twice.

    Args:
        height: of the can [m].
        duration: how long each attempt lasts [s].
        show: show the robot live in the browser.
    """
    can = Cylinder(name="can", position=(0.45, -0.2), radius=0.06, height=height, mass=0.5, colour="#3c7ab5")
    traces = []
    for name, whole_body in (("arms alone", False), ("whole body", True)):
        source = BehaviourSource(lambda view, helps=whole_body: pick(view, height / 2, helps))
        simulation = Simulation(scene=Scene((can,)))
        trace = watch(
            load_controller("qp"), source, simulation, UpperBodySource(load_robot()), duration=duration, show=show
        )
        traces.append(dataclasses.replace(trace, name=name))
        rise = 100 * (trace.object_pose[:, 0, 2].max() - trace.object_pose[0, 0, 2])
        lowest, lean = trace.command[:, 5].min(), trace.command[:, 6].max()
        print(f"{name}: {source.ending}")
        print(f"  lifted by {rise:.0f} cm, lowest h {lowest:.2f} m, largest p {lean:.2f} rad, {trace.fate}")
    keep_replay("out/05.html", traces)


if __name__ == "__main__":
    run_script(main)
