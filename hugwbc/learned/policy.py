"""A trained policy as a controller: loaded from safetensors, without the training code."""

import pathlib
from typing import Any

import numpy as np
import torch

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES, Command
from hugwbc.controller import JointCommand, UpperBody, override_arms
from hugwbc.errors import PolicyFileError, UnknownNameError
from hugwbc.learned import checkpoint
from hugwbc.learned import observations as obs
from hugwbc.learned.config import EnvConfig
from hugwbc.learned.networks import Actor
from hugwbc.robot import load_robot, model_dir
from hugwbc.state import RobotState

DEFAULT_POLICY = "h1"
PERIOD = 0.02  # [s], the paper's control period
ACTION_SCALE = EnvConfig.action_scale
POLICY_FILE = "policy.safetensors"


def policy_metadata(waist_rate: float = EnvConfig.waist_rate) -> dict[str, Any]:
    """The contract that a policy file carries: everything needed to run it elsewhere.

    Args:
        waist_rate: speed at which the waist's joint target follows the commanded w [rad/s].
    """
    robot = load_robot()
    return {
        "robot": "h1",
        "joint_names": list(robot.joint_names),
        "nominal": robot.nominal.tolist(),
        "kp": robot.kp.tolist(),
        "kd": robot.kd.tolist(),
        "period": PERIOD,
        "action_scale": ACTION_SCALE,
        "waist_rate": waist_rate,
        "command_names": list(COMMAND_NAMES),
        "command_scales": obs.COMMAND_SCALES,
        "history_frames": obs.HISTORY_FRAMES,
        "proprioception": "angular velocity x 0.25, projected gravity, q - nominal, dq x 0.05, last action",
        "command": "eight scaled commands, psi, phi_stance (1 standing), left and right clock, intervention indicator",
    }


def policy_dir() -> pathlib.Path:
    """Folder of the shipped policies."""
    return model_dir() / "policies"


def shipped_policies() -> list[str]:
    """Names of the shipped policies."""
    return sorted(path.parent.name for path in policy_dir().glob(f"*/{POLICY_FILE}"))


def load_policy(name_or_path: str | pathlib.Path = DEFAULT_POLICY, *, threads: int | None = 1) -> "LearnedController":
    """A controller from a shipped policy's name, a policy file, or a folder that holds one.

    Args:
        name_or_path: "h1", or a path.
        threads: that torch may use in this process; None leaves torch's own choice. For one robot more than one only
            costs: on a busy machine, threads that wait for each other made a tick of 0.4 ms last 55 ms.

    Raises:
        UnknownNameError: if it is neither a shipped policy nor an existing path.
        PolicyFileError: if the file is truncated, corrupted, of another program or another robot.
    """
    if threads is not None:
        torch.set_num_threads(threads)
    path = pathlib.Path(name_or_path)
    if not path.exists():
        path = policy_dir() / str(name_or_path)
        if not path.exists():
            raise UnknownNameError("policy", name_or_path, [*shipped_policies(), "the path of a policy file or folder"])
    if path.is_dir():
        path = path / POLICY_FILE
    tensors, metadata = checkpoint.load_file(path, "policy")
    expected = policy_metadata()
    for key in ("robot", "joint_names", "history_frames", "command_names", "command_scales", "action_scale", "period"):
        if metadata.get(key) != expected[key]:
            raise PolicyFileError(
                f"{path} has {key} = {metadata.get(key)}, this version of hugwbc runs {expected[key]}; "
                "use a policy trained with this version"
            )
    if not isinstance(metadata.get("waist_rate"), int | float):
        raise PolicyFileError(f"{path} lacks the number waist_rate; use a policy trained with this version")
    actor = Actor()
    try:
        actor.load_state_dict(tensors)
    except RuntimeError as error:
        raise PolicyFileError(f"{path} does not fit the policy network: {error}") from error
    return LearnedController(actor, metadata)


class LearnedController:
    """The policy behind the common controller interface.

    Attributes:
        name: "learned".
        period: time between two actions [s].
        metadata: the policy's contract and training record.
        held: how often a non-finite state was replaced by the last good observation.
    """

    name = "learned"

    def __init__(self, actor: Actor, metadata: dict[str, Any]) -> None:
        """Run a given network.

        Args:
            actor: the trained network.
            metadata: its contract.
        """
        self.period = PERIOD
        self.metadata = metadata
        self.held = 0
        self.robot = load_robot()
        self._actor = actor.eval()
        self._nominal = torch.tensor(self.robot.nominal, dtype=torch.float32)
        self._history = torch.zeros(1, obs.HISTORY_FRAMES, obs.PROPRIOCEPTION_SIZE)
        self._action = torch.zeros(1, obs.JOINTS)
        self._phase = 0.0
        self._waist = 0.0
        self._waist_step = float(metadata["waist_rate"]) * self.period
        self._started = False

    def reset(self, state: RobotState) -> None:
        """Forget the past; the history starts filled with the first frame."""
        self._action.zero_()
        self._phase = 0.0
        self._waist = 0.0
        self._started = False
        if state.is_finite:
            self._push(state)

    def _push(self, state: RobotState) -> None:
        def row(values: np.ndarray) -> torch.Tensor:
            return torch.as_tensor(values, dtype=torch.float32)[None]

        frame = obs.proprioception(
            row(state.angular_velocity),
            row(state.projected_gravity),
            row(state.q) - self._nominal,
            row(state.dq),
            self._action,
        )
        if self._started:
            self._history = torch.cat((self._history[:, 1:], frame[:, None]), dim=1)
        else:
            self._history[:] = frame
            self._started = True

    @torch.no_grad()
    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Joint targets for the next period; arms under external control take their targets.

        A state that is not finite leaves the history as it was. Commands outside their ranges are clamped.
        """
        if state.is_finite:
            self._push(state)
        else:
            self.held += 1
        command, _ = command.clamp()
        self._phase = float(gaits.advance_phase(self._phase, command.f, self.period))
        feet = gaits.foot_phases(torch.tensor([self._phase]), torch.tensor([int(command.gait)]))
        observation = obs.command_observation(
            torch.as_tensor(command.array(), dtype=torch.float32)[None],
            torch.tensor([int(command.gait)]),
            gaits.clock(gaits.homogenised_phase(feet)),
            torch.tensor([upper_body.indicator]),
        )
        self._action, _ = self._actor(self._history.flatten(1), observation)
        q = self.robot.nominal + ACTION_SCALE * self._action[0].double().numpy()
        self._waist += float(np.clip(command.w - self._waist, -self._waist_step, self._waist_step))
        q[self.robot.waist] += self._waist
        return override_arms(JointCommand.position(self.robot, q), upper_body, self.robot)
