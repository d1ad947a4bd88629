"""Contracts: what is needed to run a policy's network, ours or another project's.

docs/evaluation.md describes every field. Our own policies carry a contract in their metadata, and other people's have
one as YAML beside the network's file.
"""

import dataclasses
import functools
import pathlib
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo

from hugwbc.commands import COMMAND_NAMES, command_ranges
from hugwbc.errors import ConfigError, HugwbcError, PolicyFileError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.learned.policy.network_files import CONTRACT_FILE, policy_file
from hugwbc.learned.policy.terms import TERMS
from hugwbc.robot import Robot, RobotName, load_robot
from hugwbc.robot_tables import DEFAULT_ROBOT
from hugwbc.settings import Beside, Gain, NotNegative, Positive, Share, one_of, refusing, settings
from hugwbc.settings_file import load

_KINDS_OF_JOINTS = ("joint_position", "absolute_joint_position", "joint_velocity")
_OF_THE_CLOCK = ("phase_sin", "phase_cos", "foot_sin", "foot_cos")
LARGEST_CHANGE = {"v_x": 0.3, "v_y": 0.25, "omega": 0.3, "h": 0.06, "p": 0.1, "w": 0.3, "l": 0.3}
"""Largest difference between a command and what is asked for [m/s, m/s, rad/s, m, rad, rad, m]. The gait's clock takes
f as it is, so that f has no curve."""
Curves = dict[str, dict[str, list[list[float]]]]  # gait -> command -> pairs (command, what to ask for)
_MOST_KNOTS = 100
_L = COMMAND_NAMES.index("l")
_BEYOND = 0.2  # [rad], by which another project's pose may lie beyond our range of a joint

MOST_STOP = (0.3, 0.3, 0.5)  # [m, m, rad], by which a stop may move a robot in its heading frame, either way
_StopWay = Annotated[float, Field(ge=-MOST_STOP[0], le=MOST_STOP[0])]
_StopTurn = Annotated[float, Field(ge=-MOST_STOP[2], le=MOST_STOP[2])]
CommandName = Annotated[str, one_of("command", lambda: COMMAND_NAMES)]


def _once(names: tuple[str, ...]) -> tuple[str, ...]:
    for index, name in enumerate(names):
        if name in names[:index]:
            raise ConfigError(f"'{name}' is listed twice; keep one", at=(index,))
    return names


def _known(names: Iterable[str], robot: Robot, *place: str | int) -> None:
    for name in names:
        if name not in robot.joint_names:
            raise UnknownNameError("joint", name, robot.joint_names, at=place)


def _of_robot(names: Any, info: ValidationInfo) -> Any:  # noqa: ANN401  what a file holds
    """Return the names, or all joints of the contract's robot for "all"; refuse names that are no joints of it."""
    robot = load_robot(info.data.get("robot", DEFAULT_ROBOT))
    _known(names if isinstance(names, list | tuple) else (), robot)
    return robot.joint_names if names == "all" else names


def check_curves(curves: Curves) -> Curves:
    """Return the curves, which must have rising commands, and ask for values close to them or for a part of them.

    Close is within `LARGEST_CHANGE`; a part has the same sign and is not larger.
    """
    for label, of_gait in curves.items():
        Gait.parse(label)
        for name, pairs in of_gait.items():
            if name not in LARGEST_CHANGE:
                raise UnknownNameError("command with a curve", name, LARGEST_CHANGE, at=(label,))
            if not 2 <= len(pairs) <= _MOST_KNOTS or any(len(pair) != 2 for pair in pairs):
                raise ConfigError(f"a curve is not 2 to {_MOST_KNOTS} pairs of numbers", at=(label, name))
            knots, asked = np.array(pairs).T
            limit = LARGEST_CHANGE[name]
            part = (asked * knots >= 0.0) & (np.abs(asked) <= np.abs(knots))  # what it can do of a command
            if not (np.diff(knots) > 0.0).all() or (np.abs(asked - knots)[~part] > limit + 1e-9).any():
                raise ConfigError(
                    f"the curve of {label} {name} falls, or changes a command by more than {limit}; give "
                    "rising commands and what to ask for, which is close to them or a part of them",
                    at=(label, name),
                )
    return curves


Joints = Annotated[tuple[str, ...], Field(min_length=1), AfterValidator(refusing(_once))]


def _for_each(value: Any, info: ValidationInfo) -> Any:  # noqa: ANN401
    """Repeat a single number for each joint, and refuse lists of another length."""
    joints = info.data.get("joints", ())
    if isinstance(value, int | float):
        return (value,) * len(joints)
    if isinstance(value, list | tuple | np.ndarray) and joints and len(value) != len(joints):
        raise ConfigError(f"found {len(value)} numbers; give {len(joints)}, one per joint, or a single one for all")
    return value


_EACH = BeforeValidator(refusing(_for_each))
Angles = Annotated[tuple[float, ...], _EACH]
Gains = Annotated[tuple[Annotated[float, Field(ge=0, le=1e4)], ...], _EACH]
ActionScales = Annotated[tuple[Annotated[float, Field(ge=0, le=10)], ...], _EACH]


@settings
class Term:
    """One part of an observation."""

    term: Annotated[str, one_of("observation term", lambda: (*TERMS, "constant"))]  # one of `TERMS`, or "constant"
    scale: float | tuple[float, ...] = 1.0  # a factor for all its numbers, or one for each
    # joints of a term that has them, or "all"; None for those that the policy moves
    joints: Joints | Literal["all"] | None = None
    names: tuple[CommandName, ...] | None = None  # commands of the term "command"; None for all
    # shift of the clock for a term that reads it, within one cycle [cycles]
    offset: Annotated[float, Field(gt=-1, lt=1)] = 0.0
    value: tuple[float, ...] = ()  # numbers of a constant

    def __post_init__(self) -> None:
        if (self.term == "constant") != bool(self.value):
            raise ConfigError("a constant, and nothing else, has a value: {constant: {value: [...]}}", at=("value",))
        if self.joints is not None and self.term not in _KINDS_OF_JOINTS:
            raise ConfigError(f"{self.term} takes no joints; leave them out", at=("joints",))
        if self.names is not None and self.term != "command":
            raise ConfigError(f"{self.term} takes no names; leave them out", at=("names",))
        if self.offset and self.term not in _OF_THE_CLOCK:
            raise ConfigError(f"{self.term} reads no clock; leave the offset out", at=("offset",))


def _spelled_out(entry: Any) -> Any:  # noqa: ANN401
    """Return the fields of `gravity`, or of `command: {names: [v_x]}`."""
    if isinstance(entry, str):
        return {"term": entry}
    if isinstance(entry, Mapping) and len(entry) == 1:
        ((name, fields),) = entry.items()
        return {"term": name, **fields} if isinstance(fields, Mapping) else entry
    return entry


Terms = tuple[Annotated[Term, BeforeValidator(_spelled_out)], ...]


@settings
class History:
    """The arrangement of earlier observations in the network's input."""

    frames: Annotated[int, Field(ge=1, le=1000)] = 1  # number of observations in the input, including the newest
    order: Literal["oldest_first", "newest_first"] = "oldest_first"  # order in time
    # by_frame: whole observations one after the other; by_term: each term with its past
    layout: Literal["by_frame", "by_term"] = "by_frame"
    start: Literal["first_frame", "zeros"] = "first_frame"  # what replaces observations before the first


@settings(kw_only=True)
class Contract:
    """Everything about a policy that its network does not say; SI units, radians."""

    name: str = ""  # short name for tables; by default that of the file or folder
    robot: RobotName = DEFAULT_ROBOT  # robot that the policy was made for
    period: Annotated[float, Field(ge=1e-3, le=1)]  # time between two actions [s]
    # joints that the policy moves, in the order of its actions; the others are held
    joints: Annotated[Joints, BeforeValidator(refusing(_of_robot))]
    default_pose: Angles  # positions of these joints at action 0 [rad]
    # kp and kd: gains of these joints [N*m/rad], [N*m*s/rad]
    kp: Gains
    kd: Gains
    action_scale: ActionScales  # joint target per unit of action, for each joint [rad]
    observation: Annotated[Terms, Field(min_length=1)]  # terms of the network's input
    history: History = dataclasses.field(default_factory=History)  # earlier observations in that input
    command: Terms = ()  # terms of a second input, which has no history; the network has none if there are no terms
    action_clip: Positive | None = None  # largest size of an action, before scaling
    observation_clip: Positive | None = None  # largest size of a number of the scaled inputs
    # recurrent state of an ONNX network: the name of each state input and of the output with its next value. A
    # TorchScript network keeps its state itself
    state: dict[str, str] = dataclasses.field(default_factory=dict)
    # network's output that holds the actions: its name, or its number in the tuple of a TorchScript network; by default
    # the one called action or actions, or the only one with a number for each joint
    action: str = ""
    # period of the clock [s]; None for a clock that follows the commanded stride frequency
    clock_period: Positive | None = None
    # positions of joints that the policy does not move, if they differ from the robot's nominal pose [rad]
    held_pose: dict[str, float] = dataclasses.field(default_factory=dict)
    waist_rate: NotNegative = 0.0  # speed at which the waist's joint target follows the commanded w [rad/s]
    # factor on the commanded height and pitch that the legs' joint targets follow
    # (`hugwbc.learned.policy.leg_feed_forward`)
    squat_gain: Gain = 0.0
    swing_gain: Share = 0.0  # share of the clock's swing of the feet, up to the commanded height, that they follow
    # what to ask the network for, by gait and command: pairs of a command and its value in `asked`
    feed_forward: Annotated[Curves, AfterValidator(refusing(check_curves))] = dataclasses.field(default_factory=dict)
    # by how much a stop in mid-stance moves the robot: ahead, to the left and in heading [m, m, rad]
    stop: tuple[_StopWay, _StopWay, _StopTurn] = (0.0, 0.0, 0.0)
    # file of the network, TorchScript (.pt, .pth, .ts, .jit) or ONNX (.onnx), relative to the contract's folder; None
    # if it is given otherwise
    policy: Beside | None = None

    def __post_init__(self) -> None:
        _known(self.held_pose, self.described, "held_pose")
        for group in ("observation", "command"):
            for index, term in enumerate(getattr(self, group)):
                if isinstance(term.joints, tuple):
                    _known(term.joints, self.described, group, index, term.term, "joints")
                size = self.size(term)
                if isinstance(term.scale, tuple) and len(term.scale) != size:
                    problem = f"{term.term} has {len(term.scale)} scales; give {size}, one per number, or a single one"
                    raise ConfigError(problem, at=(group, index))
        for name in self.held_pose:
            if name in self.joints:
                raise ConfigError(f"the policy moves '{name}'; leave it out of held_pose", at=("held_pose", name))
        poses = {"default_pose": dict(zip(self.joints, self.default_pose, strict=True)), "held_pose": self.held_pose}
        for field, pose in poses.items():
            for index, (name, angle) in enumerate(pose.items()):
                joint = self.described.indices((name,))[0]
                low, high = self.described.lower[joint], self.described.upper[joint]
                if not low - _BEYOND <= angle <= high + _BEYOND:
                    problem = f"{name} is at {angle:g} rad, and turns from {low:g} to {high:g} rad"
                    raise ConfigError(problem, at=(field, name if field == "held_pose" else index))

    @functools.cached_property
    def described(self) -> Robot:
        """Description of the robot."""
        return load_robot(self.robot)

    def columns(self, term: Term) -> np.ndarray | None:
        """Return the indices of the numbers of a term of `TERMS` that are read; None for all."""
        if term.term in _KINDS_OF_JOINTS and term.joints != "all":
            return self.described.indices(self.joints if term.joints is None else term.joints)
        return None if term.names is None else np.array([COMMAND_NAMES.index(name) for name in term.names])

    def size(self, term: Term) -> int:
        """Return how many numbers a term has."""
        if term.term in ("last_action", "constant"):
            return len(self.joints) if term.term == "last_action" else len(term.value)
        columns = self.columns(term)
        return TERMS[term.term].count(self.described) if columns is None else len(columns)

    @property
    def observation_size(self) -> int:
        """Number of values of one observation, without history."""
        return sum(map(self.size, self.observation))

    @property
    def input_sizes(self) -> tuple[int, ...]:
        """Sizes of the network's inputs: observations with their history, and commands if they are a second input."""
        sizes = (self.observation_size * self.history.frames, sum(map(self.size, self.command)))
        return sizes if self.command else sizes[:1]

    @property
    def follows_gait(self) -> bool:
        """Whether the policy reads our gait or the phases of its feet."""
        return any(term.term in ("gait", "foot_sin", "foot_cos") for term in (*self.observation, *self.command))

    def asked(self, command: np.ndarray, gait: np.ndarray) -> np.ndarray:
        """Return what to ask the network for, so that it executes commands, shape (n, 8).

        A trained policy is often precise but biased: it walks at 1.09 of the commanded speed, or squats two centimetres
        too little. Curves that were measured once, linear between knots, take the mean error out. They use no
        measurement at run time, so that they cannot make anything unstable, and they cannot take out what changes from
        robot to robot. Commands without a curve are unchanged.

        A curve may ask for swings that are higher than any command, since drives follow swings late. Only the
        feed-forward of the legs takes such values (`leg_feed_forward`); the network reads values within the range of
        its training (`read`).

        Args:
            command: commands, shape (n, 8).
            gait: values of `Gait`, shape (n,).
        """
        result = command.copy()
        for label, of_gait in self.feed_forward.items():
            rows = gait == int(Gait.parse(label))
            for name, pairs in of_gait.items() if rows.any() else ():
                column, (knots, asked) = COMMAND_NAMES.index(name), np.array(pairs, dtype=float).T
                result[rows, column] += np.interp(command[rows, column], knots, asked - knots)
        return result

    def read(self, asked: np.ndarray) -> np.ndarray:
        """Return what the network reads, given `asked`, shape (n, 8): swing heights end at the highest command."""
        result = asked.copy()
        result[:, _L] = np.minimum(asked[:, _L], command_ranges(Gait.WALKING, self.described)["l"].finishing[1])
        return result


def load_contract(name: str | pathlib.Path) -> Contract:
    """Load a contract by the name of a shipped one, by path, or from a folder with a `contract.yaml`."""
    path = policy_file(name)
    contract = load(Contract, path)
    folder = path.name == CONTRACT_FILE
    return contract if contract.name else dataclasses.replace(contract, name=path.parent.name if folder else path.stem)


def contract_of(metadata: Mapping[str, Any], origin: pathlib.Path) -> Contract:
    """Return the contract in a network's metadata.

    The table of a robot of your own is looked for where it was, then in the robot's folder beside the network.

    Raises:
        PolicyFileError: if there is no contract, or one that is not valid here.
    """
    fields = metadata.get("contract")
    if not isinstance(fields, Mapping):
        raise PolicyFileError(f"{origin} has no contract that this hugwbc reads; use the version that wrote it")
    table = pathlib.Path(str(fields.get("robot")))
    beside = origin.parent / table.stem / table.name
    if beside.is_file() and not table.exists():
        fields = {**fields, "robot": str(beside)}
    try:
        return Contract(**fields)
    except (HugwbcError, TypeError) as error:
        hint = (
            "use a policy that this version wrote; a robot of your own needs its table where it was or, in its folder, "
            "beside the policy, and a term of your own the Python file that adds it to TERMS"
        )
        raise PolicyFileError(f"the contract of {origin} is not valid: {error}; {hint}") from error
