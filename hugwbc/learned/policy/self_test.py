"""The self-test in a policy file: sensor readings and commands, and the joint targets that they must give."""

import numpy as np
import torch

from hugwbc.commands import COMMAND_NAMES, Command, command_ranges
from hugwbc.controller import UpperBody
from hugwbc.gait import Gait
from hugwbc.learned.policy.network_policy import NetworkPolicy
from hugwbc.robot import Robot
from hugwbc.state import RobotState

PREFIX = "self_test."  # of the names of its tensors in the file
TOLERANCE = 1e-4  # [rad] of joint targets; float32 differs by about 1e-6 between machines
_INPUTS = ("orientation", "angular_velocity", "q", "dq", "command", "gait", "arms", "intervention")
_STEPS_EACH = 6  # of each gait, one more than the history holds
_SEED = 0


def _inputs(robot: Robot) -> dict[str, torch.Tensor]:
    """Make up an episode with every gait, commands over their ranges, and arms at times under external control."""
    rng = np.random.default_rng(_SEED)
    steps, joints = _STEPS_EACH * len(Gait), len(robot.joint_names)
    tilt = 0.2 * rng.standard_normal((steps, 3))
    orientation = np.column_stack((np.ones(steps), tilt))
    ranges = command_ranges(Gait.WALKING, robot)
    low, high = np.array([ranges[name].initial for name in COMMAND_NAMES]).T
    command = rng.uniform(low, high, (steps, len(COMMAND_NAMES)))
    gait = np.repeat([int(gait) for gait in Gait], _STEPS_EACH)
    command[gait == Gait.STANDING, :3] = 0.0
    arrays = {
        "orientation": orientation / np.linalg.norm(orientation, axis=1, keepdims=True),
        "angular_velocity": rng.standard_normal((steps, 3)),
        "q": robot.nominal + 0.2 * rng.standard_normal((steps, joints)),
        "dq": 2.0 * rng.standard_normal((steps, joints)),
        "command": command,
        "gait": gait,
        "arms": rng.uniform(-0.5, 0.5, (steps, len(robot.arms))),
        "intervention": np.arange(steps) % 3 == 2,
    }
    return {name: torch.from_numpy(array) for name, array in arrays.items()}


def _targets(controller: NetworkPolicy, inputs: dict[str, torch.Tensor]) -> torch.Tensor:
    """Return the joint targets of the controller at every step, shape (k, joints)."""
    rows = {name: inputs[name].numpy() for name in _INPUTS}
    targets = []
    for i in range(len(rows["q"])):
        state = RobotState(*(rows[name][i] for name in ("q", "dq", "orientation", "angular_velocity")))
        if i == 0:
            controller.reset(state)
        command, _ = Command.from_array(rows["command"][i], Gait(int(rows["gait"][i]))).clamp()
        upper_body = UpperBody.targets(rows["arms"][i]) if rows["intervention"][i] else UpperBody.none()
        targets.append(torch.from_numpy(controller.act(state, command, upper_body).q))
    return torch.stack(targets)


def record(controller: NetworkPolicy) -> dict[str, torch.Tensor]:
    """Record what to store with a policy, in k successive calls after a reset; names begin with `PREFIX`.

    Inputs are orientation (k, 4), angular_velocity (k, 3), q and dq (k, joints), command (k, 8), gait (k,), arms
    (k, arm joints) and intervention (k,); they give target (k, joints), the joint targets [rad].
    """
    inputs = _inputs(controller.robot)
    return {PREFIX + name: tensor for name, tensor in (inputs | {"target": _targets(controller, inputs)}).items()}


def deviation(controller: NetworkPolicy, stored: dict[str, torch.Tensor]) -> float:
    """Return the largest difference between joint targets and stored ones [rad]; inf if any is not finite.

    Args:
        controller: the controller to test; its episode ends with the test.
        stored: what `record` returned.

    Raises:
        LookupError, TypeError, ValueError: if the stored tensors are not those of a self-test.
    """
    inputs = {name: stored[PREFIX + name] for name in _INPUTS}
    expected, found = stored[PREFIX + "target"], _targets(controller, inputs)
    if expected.shape != found.shape:
        raise ValueError(f"targets of shape {tuple(expected.shape)}")
    difference = float((found - expected).abs().max())
    return difference if np.isfinite(difference) else float("inf")
