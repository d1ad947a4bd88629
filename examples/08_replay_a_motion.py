"""Replay a motion file with the arms while the robot stands: any source of arm joint targets can take the arms over.

Without a file, a motion is generated, written, and read again.

    python examples/08_replay_a_motion.py --file motion.npz
"""

import pathlib
import tempfile

import numpy as np
import tyro

from hugwbc import Command, UpperBody
from hugwbc.mbc import WholeBodyController
from hugwbc.scripts.motion import generate_motions, load_motion
from hugwbc.sim import Simulation
from hugwbc.upper_ik import Takeover


def main(file: pathlib.Path | None = None, duration: float = 5.0) -> None:
    """Replay.

    Args:
        file: of the motion (.npz).
        duration: how long [s].
    """
    with tempfile.TemporaryDirectory() as folder:
        if file is None:
            file = pathlib.Path(folder) / "generated.npz"
            generate_motions(seed=0, count=1, duration=duration)[0].save(file)
        motion = load_motion(file)
    simulation, controller, takeover = Simulation(), WholeBodyController(), Takeover()
    smooth = motion.resampled(1.0 / controller.period)
    velocity = np.gradient(smooth.positions, controller.period, axis=0)
    state, errors = simulation.reset(), []
    controller.reset(state)
    body = UpperBody.none()
    for q, dq in zip(smooth.positions, velocity, strict=True):
        if state.time >= duration:
            break
        body = takeover.follow(q, dq, controller.period)
        state = simulation.step(controller.act(state, Command(), body), controller.period)
        errors.append(np.abs(state.q[simulation.robot.arms] - body.q).mean())
    print(f"{motion.name}: {motion.duration:.1f} s, arm joints {np.mean(errors):.3f} rad from their targets")
    print("fallen" if simulation.fallen else "standing")


if __name__ == "__main__":
    tyro.cli(main)
