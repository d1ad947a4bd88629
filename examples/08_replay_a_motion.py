"""Replay a motion file with the arms while the robot stands: joint targets take the arms over as hand targets do.

Without a file, a motion is generated, written, and read again.

    python examples/08_replay_a_motion.py --file motion.npz --show
"""

import pathlib
import tempfile

import numpy as np

from hugwbc import load_robot
from hugwbc.runtime import UpperBodySource, load_controller
from hugwbc.scripts import Script, Segment, generate_motions, load_motion
from hugwbc.viz.show import run_script, watch


def main(file: pathlib.Path | None = None, duration: float | None = None, show: bool = False) -> None:
    """Replay.

    Args:
        file: motion file (.npz or .csv).
        duration: how long to run [s]; that of the motion, if not given.
        show: show the robot live in the browser.
    """
    robot = load_robot()
    with tempfile.TemporaryDirectory() as folder:
        if file is None:
            file = pathlib.Path(folder) / "generated.npz"
            generate_motions(robot, seed=0, count=1, duration=5.0)[0].save(file)
        motion = load_motion(file, robot)
    duration = motion.duration if duration is None else duration
    controller = load_controller("qp")
    script = Script(motion.name, (Segment("replay", duration, motion=motion, ramp=0.0),))
    hands = UpperBodySource(robot)
    trace = watch(controller, script, upper_body=hands, duration=duration, show=show, replay="out/08.html")

    error = np.abs(trace.qpos[:, 7 + robot.arms] - trace.arm_target)[len(trace.time) // 2 :].mean()
    print(f"{motion.name}: {motion.duration:.1f} s, arm joints {error:.3f} rad from their targets")
    print(f"The robot {trace.fate}.")


if __name__ == "__main__":
    run_script(main)
