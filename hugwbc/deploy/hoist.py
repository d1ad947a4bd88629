"""A hoist that holds a simulated robot by an elastic rope."""

import mujoco
import numpy as np

from hugwbc.sim import Simulation
from hugwbc.state import GRAVITY

_HOOK = np.array([0.0, 0.0, 0.5])  # on the torso, between the shoulders and the head, in the link's frame [m]
_ROPE = 1.0  # [m] from the hook up to the pulley, when the robot stands
_STIFFNESS, _DAMPING = 5000.0, 500.0  # [N/m], [N*s/m]; the maker's 200 N/m lets an H1 sink by 3 m
_SPEED = 0.1  # [m/s] of the winch
# [m] above the stand, where the rope carries all of the weight. A lowered robot stands with two thirds of its weight on
# its feet, and the rope keeps it upright until its controller runs.
LIFTED, LOWERED = 0.1, -0.085


class Hoist:
    """A rope from a pulley above the robot to a hook on its torso, and a winch. The rope only pulls.

    Attributes:
        attached: whether the rope holds the robot.
        height: where the winch would hold the hook, above its height in the stand [m].
    """

    def __init__(self, simulation: Simulation, height: float = LIFTED) -> None:
        """Hang up a robot that has just been reset and touches the ground; the winch first goes to a height [m]."""
        self._simulation = simulation
        self._row = simulation.link_names.index(simulation.robot.trunk)
        self._pulley = self._hook() + np.array([0.0, 0.0, _ROPE])
        self._weight = simulation.robot.mass * GRAVITY
        self._distance = _ROPE
        self.attached, self.height, self._target = True, 0.0, height

    def lift(self) -> None:
        """Let the winch lift the robot off the ground."""
        self._target = LIFTED

    def lower(self) -> None:
        """Let the winch lower the robot until its feet carry most of its weight."""
        self._target = LOWERED

    def release(self) -> None:
        """Let go."""
        self.attached = False

    @property
    def tension(self) -> float:
        """Pull of the rope in the last step [N]."""
        return float(np.linalg.norm(self._simulation.external_force[self._row, :3]))

    def update(self) -> None:
        """Move the winch for one physics step, and pull."""
        simulation, dt = self._simulation, self._simulation.timestep
        self.height += float(np.clip(self._target - self.height, -_SPEED * dt, _SPEED * dt))
        hook = self._hook()
        rope = self._pulley - hook
        distance = float(np.linalg.norm(rope))
        speed, self._distance = (distance - self._distance) / dt, distance
        # At its height, the rope is stretched by the robot's weight.
        stretch = distance - (_ROPE - self.height - self._weight / _STIFFNESS)
        pull = max(_STIFFNESS * stretch + _DAMPING * speed, 0.0) if self.attached and stretch > 0.0 else 0.0
        force = pull * rope / distance
        simulation.external_force[self._row, :3] = force
        simulation.external_force[self._row, 3:] = np.cross(hook - simulation.data.xipos[self._body], force)

    @property
    def _body(self) -> int:
        return mujoco.mj_name2id(self._simulation.model, mujoco.mjtObj.mjOBJ_BODY, self._simulation.robot.trunk)

    def _hook(self) -> np.ndarray:
        data = self._simulation.data
        return data.xpos[self._body] + data.xmat[self._body].reshape(3, 3) @ _HOOK
