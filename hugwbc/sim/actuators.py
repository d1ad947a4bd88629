"""Joint drives: ideal ones, and drives with a torque-speed limit, friction and a delay as a real robot has them.

A real drive gives its full torque up to a corner speed v_c. Above it the back-EMF of the motor leaves less voltage, and
the torque that drives the joint falls linearly to zero at the joint's maximum speed v_max:

    tau <= tau_max min(1, (v_max - v) / (v_max - v_c)),   at least 0,

and the same with opposite signs of torque and speed. Braking torque, against the motion, is available in full at every
speed. The maker's own model of its drives has the same form (`UnitreeActuator` in unitree_rl_lab), but limits braking
as well.
"""

import dataclasses
import functools
from typing import Annotated

import mujoco
import numpy as np
from pydantic import Field

from hugwbc.numeric import frozen
from hugwbc.robot import Robot
from hugwbc.settings import NotNegative, settings

_LONGEST_DELAY = 0.1  # [s]
# MuJoCo's Coulomb friction is a soft constraint. As soft as its defaults make it, a joint at rest creeps by 0.03 rad/s
# under 0.9 of its friction; with this impedance, and a time constant of two time steps, by 0.0006 rad/s
# (docs/log/physics.md).
_STICK_IMPEDANCE = 0.99
_STICK_STEPS = 2.0
_LINE_SEARCH = 50  # iterations; with the 12 of the description the solver stops before the friction has converged

_WAYS = np.array([-1.0, 1.0])


@settings
class Actuators:
    """Properties of the joint drives beyond the PD law; the defaults are those of a real robot.

    Attributes:
        torque_speed: whether the torque is limited by the joint's speed.
        friction: factor on the Coulomb and viscous friction of the robot's table; 0 for none.
        armature: factor on the reflected inertia of the robot's table.
        delay: time from a joint command to its torque [s]; None for that of the robot's table. It is rounded to whole
            physics steps, but a delay above 0 is at least one step.
    """

    torque_speed: bool = True
    friction: NotNegative = 1.0
    armature: NotNegative = 1.0
    delay: Annotated[float, Field(ge=0.0, le=_LONGEST_DELAY)] | None = None

    @classmethod
    def ideal(cls) -> "Actuators":
        """Return drives that follow the PD law at once, up to their torque limit, without friction."""
        return cls(torque_speed=False, friction=0.0, armature=1.0, delay=0.0)

    def known_robot(self, robot: Robot) -> Robot:
        """Return the robot as known to a controller or estimator that is told these drives; always the same object.

        The torque-speed limit stays that of the robot's table.
        """
        drives = self.friction, self.armature, robot.command_delay if self.delay is None else self.delay
        return robot if drives == (1.0, 1.0, robot.command_delay) else _told(robot, *drives)

    def apply_to(self, model: mujoco.MjModel, robot: Robot) -> None:
        """Set friction and reflected inertia of the joints of a newly compiled model."""
        if self.friction == 0.0 and self.armature == 1.0:  # as the description has them
            return
        columns = model.jnt_dofadr[[model.joint(name).id for name in robot.joint_names]]
        model.dof_armature[columns] = self.armature * robot.armature
        model.dof_damping[columns] = robot.damping + self.friction * robot.viscous
        model.dof_frictionloss[columns] = self.friction * robot.friction
        if self.friction > 0.0:
            model.dof_solref[columns, 0] = _STICK_STEPS * model.opt.timestep
            model.dof_solimp[columns, :2] = _STICK_IMPEDANCE
            model.opt.ls_iterations = _LINE_SEARCH
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def delay_steps(self, robot: Robot, timestep: float) -> int:
        """Return the delay in physics steps of `timestep` [s]."""
        delay = robot.command_delay if self.delay is None else self.delay
        return max(1, round(delay / timestep)) if delay > 0.0 else 0


@functools.lru_cache(maxsize=64)  # other caches, such as that of the kinematics, go by the object
def _told(robot: Robot, friction: float, armature: float, delay: float) -> Robot:
    """Return a robot with factors on friction and reflected inertia, and a delay [s]."""
    factors = {"friction": friction, "viscous": friction, "armature": armature}
    vectors = {name: frozen(factor * getattr(robot, name)) for name, factor in factors.items()}
    return dataclasses.replace(robot, command_delay=delay, **vectors)


class TorqueSpeedLimit:
    """The torque that drives can give at given joint speeds."""

    def __init__(self, robot: Robot, torque_limit: np.ndarray) -> None:
        """Take the speeds from a robot, and its torque limits at low speed [N*m], shape (..., n)."""
        # The last axis of each array: downwards and upwards, as in MuJoCo's force range.
        self._limit = np.asarray(torque_limit)[..., None] * _WAYS
        self._slope = (1.0 / (robot.velocity_limit - robot.corner_speed))[:, None] * _WAYS
        self._reserve = np.abs(robot.velocity_limit[:, None] * self._slope)

    def write(self, velocity: np.ndarray, force_range: np.ndarray) -> None:
        """Write the lowest and highest torque [N*m], shape (..., n, 2), at joint speeds [rad/s], shape (..., n)."""
        share = self._reserve - velocity[..., None] * self._slope
        # A diverged robot's NaN, which MuJoCo must not see in its model, becomes 1.
        np.multiply(self._limit, np.fmax(np.fmin(share, 1.0, out=share), 0.0, out=share), out=force_range)
