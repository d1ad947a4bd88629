"""Write a controller of your own: a name, a period, `reset` and `act`, and everything else works with it.

This one stands, squats and turns its waist by PD gains, and balances by the torque of its ankles. They move the centre
of pressure beyond the capture point, above which an inverted pendulum comes to rest: x + v sqrt(z / g) (Pratt et al.,
"Capture point: a step toward humanoid push recovery", Humanoids 2006).

    python examples/10_write_a_controller.py --h -0.15 --push 60 --show
"""

import numpy as np

from hugwbc import Command, JointCommand, RobotState, UpperBody, load_robot, rotations
from hugwbc.controller import override_arms
from hugwbc.kinematics import Kinematics
from hugwbc.runtime import Force, Simulation
from hugwbc.state import GRAVITY
from hugwbc.viz.show import run_script, watch

STEEPEST = 0.85  # [rad] that the shank can lean ahead with flat feet: the range of the ankle
SPEED = np.array([0.2, 0.8])  # [m/s], [rad/s] at which height and waist follow their commands
EDGE = 0.02  # [m] of the sole at heel and toe where the ground does not push


class Squatter:
    """Holds legs and waist by PD gains at the commanded height and angle, and balances by the torque of the ankles."""

    name = "squatter"
    period = 0.01

    def __init__(self) -> None:
        self.robot = load_robot()
        self.kinematics = Kinematics(self.robot)
        self.hips, self.knees, self.ankles = (
            self.robot.indices([f"left_{part}_joint", f"right_{part}_joint"]) for part in ("hip_pitch", "knee", "ankle")
        )
        self.kp, self.kd = self.robot.kp.copy(), 2.0 * self.robot.kd
        self.kp[self.robot.legs] *= 4.0  # the paper's gains sag under the body
        self.kp[self.ankles], self.kd[self.ankles] = 0.0, self.robot.kd[self.ankles]  # the balance moves them

    def reset(self, state: RobotState) -> None:
        """Start from the nominal height and the waist straight."""
        self.now = np.zeros(2)

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return the posture for the height and the waist, and the ankle torques for the balance."""
        self.now += np.clip(np.array([command.h, command.w]) - self.now, -SPEED * self.period, SPEED * self.period)
        q, tau = self.robot.nominal.copy(), np.zeros_like(self.robot.nominal)
        # Thigh and shank lean alike, so that the hip stays above the ankle.
        lean = np.arccos(
            np.clip(np.cos(q[self.knees] / 2.0) + self.now[0] / (2.0 * self.robot.thigh), np.cos(STEEPEST), 1.0)
        )
        q[self.hips], q[self.knees], q[self.ankles], q[self.robot.waist] = -lean, 2.0 * lean, -lean, self.now[1]

        self.kinematics.update(state)
        soles = 0.5 * (self.kinematics.position("left_sole") + self.kinematics.position("right_sole"))
        ahead = rotations.rotation_z(-state.yaw)  # from the world to the heading frame
        x, _, z = ahead @ (self.kinematics.centre_of_mass() - soles)
        v = 0.0 if state.velocity is None else (ahead @ state.velocity)[0]
        capture = x + v * np.sqrt(max(z, 0.1) / GRAVITY)
        # Pressure beyond the capture point drives it back over the middle of the soles.
        heel, toe = self.robot.sole_x  # [m] ahead of the ankles
        pressure = np.clip((heel + toe) / 2.0 + 2.0 * capture, heel + EDGE, toe - EDGE)
        tau[self.ankles] = 0.5 * self.robot.weight * pressure
        return override_arms(JointCommand(q, np.zeros_like(q), self.kp, self.kd, tau), upper_body, self.robot)


def main(h: float = -0.1, w: float = 0.5, push: float = 40.0, duration: float = 6.0, show: bool = False) -> None:
    """Squat, turn the waist, and be pushed.

    Args:
        h: commanded height relative to standing [m].
        w: commanded angle of the waist [rad].
        push: force on the chest from behind, for 0.3 s halfway through [N].
        duration: how long to run [s].
        show: show the robot live in the browser.
    """
    shove = Force((push, 0.0, 0.0), start=duration / 2.0, duration=0.3)
    command = Command(h=h, w=w).validate()
    trace = watch(Squatter(), command, Simulation(), duration=duration, forces=[shove], show=show, replay="out/10.html")
    height, waist = trace.measured[-1, 3], trace.measured[-1, 5]
    print(f"commanded {h:.2f} m and {w:.2f} rad, came to {height:.2f} m and {waist:.2f} rad")
    print(f"The robot balanced with its ankles, was pushed with {push:.0f} N and {trace.fate}.")


if __name__ == "__main__":
    run_script(main)
