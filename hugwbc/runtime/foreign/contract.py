"""A description of a policy that is sufficient to run it: observation, action, gains, pose, history, state, clock."""

import dataclasses
import math
import pathlib

from hugwbc.commands import COMMAND_NAMES
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.robot import load_robot

HISTORY_ORDERS = ("oldest_first", "newest_first")
HISTORY_LAYOUTS = ("by_frame", "by_term")
HISTORY_STARTS = ("first_frame", "zeros")
LONGEST_HISTORY = 1000  # frames


@dataclasses.dataclass(frozen=True)
class Term:
    """One part of the observation.

    Attributes:
        kind: one of `observation.TERMS`.
        size: number of its values.
        scale: a factor for each value.
        names: names of the joints or commands, for the kinds that have them.
        absolute: whether joint positions are absolute instead of relative to the default pose.
        offset: offset that is added to the gait phase [cycles].
        value: the values of a constant.
    """

    kind: str
    size: int
    scale: tuple[float, ...]
    names: tuple[str, ...] = ()
    absolute: bool = False
    offset: float = 0.0
    value: tuple[float, ...] = ()


@dataclasses.dataclass(frozen=True)
class History:
    """The arrangement of earlier observations in the network's input.

    Attributes:
        frames: number of observations in the input, including the newest.
        order: order in time, one of `HISTORY_ORDERS`.
        layout: whole observations one after the other, or each term with its past; one of `HISTORY_LAYOUTS`.
        start: what replaces observations before the first; one of `HISTORY_STARTS`.
    """

    frames: int = 1
    order: str = "oldest_first"
    layout: str = "by_frame"
    start: str = "first_frame"

    def __post_init__(self) -> None:
        if not 1 <= self.frames <= LONGEST_HISTORY:
            raise ConfigError(f"history has {self.frames} frames; give 1 to {LONGEST_HISTORY}")
        for name, valid in (("order", HISTORY_ORDERS), ("layout", HISTORY_LAYOUTS), ("start", HISTORY_STARTS)):
            if getattr(self, name) not in valid:
                raise UnknownNameError(f"history {name}", getattr(self, name), valid)


@dataclasses.dataclass(frozen=True)
class PolicyContract:
    """Everything about a policy that its network file does not say.

    Attributes:
        name: short name for tables.
        policy: TorchScript (.pt, .pth) or ONNX (.onnx) file; None if the user has to give one.
        period: time between two actions [s].
        joints: joints that the policy moves, in the order of its actions; the others are held.
        default_pose: positions of these joints at action 0 [rad].
        kp, kd: gains of these joints [N*m/rad], [N*m*s/rad].
        action_scale: joint target per unit of action, for each joint [rad].
        observation: terms of the observation, in order.
        action_clip: bound of the actions, before scaling.
        observation_clip: bound of the scaled observation.
        history: earlier observations in the input.
        state: recurrent state of an ONNX network: the name of each state input and of the output with its next value.
            A TorchScript network keeps its state itself.
        clock_period: period of the gait clock [s]; None for a clock that follows the commanded stride frequency.
        held_pose: positions of joints that the policy does not move, if they differ from the robot's nominal pose
            [rad].
    """

    name: str
    policy: pathlib.Path | None
    period: float
    joints: tuple[str, ...]
    default_pose: tuple[float, ...]
    kp: tuple[float, ...]
    kd: tuple[float, ...]
    action_scale: tuple[float, ...]
    observation: tuple[Term, ...]
    action_clip: float = math.inf
    observation_clip: float = math.inf
    history: History = dataclasses.field(default_factory=History)
    state: tuple[tuple[str, str], ...] = ()
    clock_period: float | None = None
    held_pose: tuple[tuple[str, float], ...] = ()

    @property
    def observation_size(self) -> int:
        """Number of values of one observation, without history."""
        return sum(term.size for term in self.observation)

    @property
    def input_size(self) -> int:
        """Number of values of the network's input."""
        return self.observation_size * self.history.frames


def check_joints(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names if each is a joint of the robot and occurs once.

    Raises:
        UnknownNameError: if a name is not a joint.
        ConfigError: if a name occurs twice.
    """
    robot = load_robot()
    for index, name in enumerate(names):
        robot.index(name)
        if name in names[:index]:
            raise ConfigError(f"joint '{name}' is listed twice; keep one")
    return names


def check_commands(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names if each is a command.

    Raises:
        UnknownNameError: if a name is not a command.
    """
    for name in names:
        if name not in COMMAND_NAMES:
            raise UnknownNameError("command", name, COMMAND_NAMES)
    return names
