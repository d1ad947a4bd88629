"""Carry an imagined box with both hands: a shipped script, and how well the hands keep their distance.

`together` in the script gives the position of the hands relative to each other priority over where they are.

    python examples/06_carry_a_box.py --show
"""

import numpy as np

from hugwbc import RobotState
from hugwbc.kinematics import Kinematics
from hugwbc.runtime import Trace, UpperBodySource, load_controller
from hugwbc.scripts import load_script
from hugwbc.viz.show import fate, run_script, watch


def hand_distances(trace: Trace) -> np.ndarray:
    """Return the distance between the hands at each sample [m], shape (T,)."""
    kinematics, distances = Kinematics(), []
    for qpos, qvel in zip(trace.qpos, trace.qvel, strict=True):
        kinematics.update(RobotState(qpos[7:], qvel[6:], qpos[3:7], qvel[3:6], qpos[:3]))
        distances.append(np.linalg.norm(kinematics.position("left_hand") - kinematics.position("right_hand")))
    return np.array(distances)


def main(controller: str = "qp", duration: float | None = None, show: bool = False) -> None:
    """Play the script.

    Args:
        controller: qp or learned.
        duration: how much of the script to play [s]; all of it by default.
        show: show the robot live in the browser.
    """
    script, robot = load_script("carry_box"), load_controller(controller)
    hands = UpperBodySource()
    seconds = script.duration if duration is None else duration
    trace = watch(robot, script, upper_body=hands, duration=seconds, show=show, replay="out/06.html")

    targets = [script.hands_at(t) for t in trace.time]
    gaps = 100 * hand_distances(trace)[[target is not None and target.together for target in targets]]
    if gaps.size:
        print(f"{gaps.size} samples with the box, 32 cm wide: hands {gaps.mean():.1f} cm apart on average, ", end="")
        print(f"{gaps.max():.1f} cm before the grasp, {gaps.min():.1f} cm at the closest")
        print(f"The robot carried the box over {np.linalg.norm(trace.qpos[-1, :2]):.2f} m and {fate(trace)}.")
    else:
        print(f"The script ended before the box; the robot {fate(trace)}.")


if __name__ == "__main__":
    run_script(main)
