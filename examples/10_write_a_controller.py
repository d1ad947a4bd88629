"""Write a controller of your own: a name, a period, `reset` and `act`, and everything else works with it.

This one squats by turning hips, knees and ankles so that the feet stay flat below the pelvis, with PD joints alone.

    python examples/10_write_a_controller.py --h -0.1
"""

import numpy as np
import tyro

from hugwbc import Command, JointCommand, RobotState, UpperBody, load_robot
from hugwbc.controller import override_arms
from hugwbc.runtime import Constant, rollout
from hugwbc.sim import Simulation

LEG = 0.4  # thigh and shank [m]


class Squatter:
    """Bends the legs to the commanded height."""

    name = "squatter"
    period = 0.02

    def __init__(self) -> None:
        self.robot = load_robot()
        self.stiff = self.robot.kp * np.where(np.isin(np.arange(19), self.robot.legs), 3.0, 1.0)

    def reset(self, state: RobotState) -> None:
        """Nothing to forget."""

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Both legs as isosceles triangles of the commanded height."""
        q = self.robot.nominal.copy()
        hip = self.robot.index("left_hip_pitch_joint")
        nominal = np.cos(q[hip]) * 2 * LEG
        bend = np.arccos(np.clip((nominal + command.h) / (2 * LEG), -1.0, 1.0)) + q[hip]
        for side in ("left", "right"):
            for part, share in (("hip_pitch", -1.0), ("knee", 2.0), ("ankle", -1.0)):
                q[self.robot.index(f"{side}_{part}_joint")] += share * bend
        own = JointCommand(q, np.zeros(19), self.stiff, 2.0 * self.robot.kd, np.zeros(19))
        return override_arms(own, upper_body, self.robot)


def main(h: float = -0.05, duration: float = 2.0) -> None:
    """Squat.

    Args:
        h: commanded height relative to standing [m].
        duration: how long [s].
    """
    trace = rollout(Squatter(), Constant(Command(h=h).validate()), Simulation(), duration=duration)
    fate = f"fell after {trace.survived_s:.2f} s" if trace.fell else "did not fall"
    print(f"commanded {h:.2f} m, came to {trace.measured[:, 3].min():.2f} m and {fate}")
    print("it does not balance: that is what the controllers learned and qp do")


if __name__ == "__main__":
    tyro.cli(main)
