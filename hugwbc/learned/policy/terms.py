"""Observation terms: what a policy can read of a robot and its commands, by name; many robots at once.

Training, policy files and contracts of other projects' policies use the same table, `TERMS`. A Python file adds its
own: `TERMS["ankles"] = ObservationTerm(...)` (docs/how-to/add-an-observation.md). The layout says which terms our own
networks read. Nothing of it needs torch.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES, COMMAND_SIGNS, command_ranges
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.numeric import Array, double, namespace, single
from hugwbc.robot import Robot, load_mirror, other_side
from hugwbc.rotations import AXIAL_SIGNS, VECTOR_SIGNS

_VECTOR, _AXIAL = tuple(VECTOR_SIGNS.tolist()), tuple(AXIAL_SIGNS.tolist())
_ROWS, _SEED = 64, 0  # number of made-up robots on which a term is tried, and the seed of their states
_TOLERANCE = 1e-4  # of a mirror image, relative to the larger of 1 and the number


@dataclasses.dataclass(frozen=True)
class Part:
    """A few numbers of an observation that belong together."""

    about: str  # what they are
    # how many they are; "joints" or "links" for one for each of the robot's joints or `Robot.contact_links`
    size: int | Literal["joints", "links"]
    # factors, +1 or -1, that make the mirror image of the numbers; "joints", "gaits" or "links" for numbers in the
    # order of the robot's joints, of `Gait` or of `Robot.contact_links`
    signs: tuple[float, ...] | Literal["joints", "gaits", "links"]
    # whether they are those of the left side, then those of the right one: in a mirror image the two change places, and
    # `signs` are those of one side
    sides: bool = False
    scale: float | tuple[float, ...] = 1.0  # factor that brings them to about 1, one for all or one for each
    # half-width of the noise in training on a term that is read besides the paper's, in physical units; it comes on top
    # of the errors of the sensors
    noise: float = 0.0

    def count(self, robot: Robot) -> int:
        """Return how many numbers there are of a robot."""
        if isinstance(self.size, int):
            return self.size
        return len(robot.joint_names if self.size == "joints" else robot.contact_links)

    def image(self, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
        """Return partner and sign of each number of a robot: image_i = sign_i x_partner_i."""
        if self.signs == "joints":
            mirror = load_mirror(robot)
            return mirror.joint_index, mirror.joint_sign
        if self.signs == "gaits":
            return np.array([int(gait.mirrored()) for gait in Gait]), np.ones(len(Gait))
        if self.signs == "links":
            names = robot.contact_links
            return np.array([names.index(other_side(name)) for name in names]), np.ones(len(names))
        size = self.count(robot)
        places = np.arange(size)
        if not self.sides:
            return places, np.array(self.signs)
        return (places + size // 2) % size, np.tile(self.signs, 2)


def size_of(parts: Iterable[Part], robot: Robot) -> int:
    """Return how many numbers parts have together for a robot."""
    return sum(part.count(robot) for part in parts)


@dataclasses.dataclass(frozen=True, eq=False)
class Sensed:
    """What n robots sense and are told; in training, with the errors of the sensors.

    Attributes:
        angular_velocity: of the pelvis in its own frame [rad/s], shape (n, 3).
        gravity: unit vector of gravity in the pelvis frame, shape (n, 3).
        q, dq: joint positions [rad] and velocities [rad/s], shape (n, joints).
        action: the policy's last output, shape (n, number of its joints).
        command: in the order of `COMMAND_NAMES`, shape (n, 8).
        gait: values of `Gait`, shape (n,).
        phase: common phase of the gait, in [0, 1), shape (n,).
        indicator: whether the arms are under external control, shape (n,), bool.
        pose: joint positions at action 0 [rad], shape (joints,).
        velocity: of the pelvis in its own frame [m/s], shape (n, 3); None where nothing estimates it.
    """

    angular_velocity: Array
    gravity: Array
    q: Array
    dq: Array
    action: Array
    command: Array
    gait: Array
    phase: Array
    indicator: Array
    pose: Array
    velocity: Array | None = None

    @functools.cached_property
    def feet(self) -> Array:
        """Phases of the left and the right foot, shape (n, 2)."""
        return gaits.foot_phases(double(self.phase), self.gait)

    @functools.cached_property
    def on_cpu(self) -> "Sensed":
        """The same in NumPy arrays."""
        arrays = self._rows() | {"pose": self.pose}
        return dataclasses.replace(self, **{name: value.numpy(force=True) for name, value in arrays.items()})

    def _rows(self) -> dict[str, Array]:
        """Return the fields with a row for each robot, by name, without those that are None."""
        names = [field.name for field in dataclasses.fields(self) if field.name != "pose"]
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    def mirrored(self, robot: Robot) -> "Sensed":
        """Return what the mirror images of the robots sense."""
        joints, asked = load_mirror(robot).joints, [Gait(int(gait)) for gait in self.gait]
        return dataclasses.replace(
            self,
            angular_velocity=self.angular_velocity * AXIAL_SIGNS,
            gravity=self.gravity * VECTOR_SIGNS,
            q=joints(self.q),
            dq=joints(self.dq),
            action=joints(self.action),
            command=self.command * COMMAND_SIGNS,
            gait=np.array([int(gait.mirrored()) for gait in asked]),
            phase=(self.phase + [gait.offset for gait in asked]) % 1.0,  # the left foot's becomes the right one's
            velocity=None if self.velocity is None else self.velocity * VECTOR_SIGNS,
        )

    def row(self, place: int) -> "Sensed":
        """Return one robot's, as n = 1."""
        return dataclasses.replace(self, **{name: value[place : place + 1] for name, value in self._rows().items()})


@dataclasses.dataclass(frozen=True, kw_only=True)
class ObservationTerm(Part):
    """A term: what `Part` declares, and how it is made.

    Attributes:
        read: returns the numbers in physical units, shape (n, size); each row depends on the same row of `Sensed`
            alone. It keeps nothing between calls.
        tensors: whether `read` takes torch tensors as well (`hugwbc.numeric`). Otherwise it gets NumPy arrays in
            training too; on a GPU, the numbers then go to the processor and back.
    """

    read: Callable[[Sensed], Array]
    tensors: bool = False


def scaled(value: Array, scale: ArrayLike) -> Array:
    """Return numbers as a network reads them: float32, and 0 in place of what is not finite."""
    if namespace(value) is np:
        numbers = np.asarray(value).astype(np.float32) * np.asarray(scale, dtype=np.float32)
        return np.nan_to_num(numbers, copy=False, posinf=0.0, neginf=0.0)
    factor = namespace(value).tensor(scale, device=value.device) if isinstance(scale, tuple) else scale
    return (value.float() * factor).nan_to_num(posinf=0.0, neginf=0.0)


def observe(terms: Iterable[ObservationTerm], sensed: Sensed) -> Array:
    """Return the numbers of terms side by side, as a network reads them, shape (n, sum of sizes), float32."""
    xp, gait = namespace(sensed.gait), sensed.gait
    rows = [scaled(_numbers(term, sensed), term.scale) for term in terms]
    return xp.concatenate([single(gait[:, None])[:, :0], *rows], 1)


def _numbers(term: ObservationTerm, sensed: Sensed) -> Array:
    if term.tensors or namespace(sensed.gait) is np:
        return term.read(sensed)
    return namespace(sensed.gait).as_tensor(term.read(sensed.on_cpu), device=sensed.gait.device)


# The table ------------------------------------------------------------------------------------------------------------


def _pelvis_velocity(sensed: Sensed) -> Array:
    velocity, command = sensed.velocity, sensed.command
    return namespace(command).zeros_like(command[:, :3]) if velocity is None else velocity


def _wave(name: Literal["sin", "cos"], phase: Callable[[Sensed], Array]) -> Callable[[Sensed], Array]:
    def read(sensed: Sensed) -> Array:
        angle = 2.0 * math.pi * double(phase(sensed))
        return getattr(namespace(angle), name)(angle)

    return read


_term = functools.partial(ObservationTerm, tensors=True)


# Scales bring each command to about 1. They are ours: the authors scale l by 0.15, which hides it from the network.
_COMMAND_SCALES = {"v_x": 2.0, "v_y": 2.0, "omega": 1.0, "f": 1.0, "l": 4.0, "h": 2.0, "p": 2.0, "w": 1.0}

TERMS: dict[str, ObservationTerm] = {
    "angular_velocity": _term(
        about="angular velocity of the pelvis in its own frame",
        size=3,
        signs=_AXIAL,
        scale=0.25,
        read=lambda s: s.angular_velocity,
    ),
    "linear_velocity": _term(
        about="velocity of the pelvis in its own frame, 0 where nothing estimates it",
        size=3,
        signs=_VECTOR,
        read=_pelvis_velocity,
    ),
    "gravity": _term(
        about="unit vector of gravity in the pelvis frame",
        size=3,
        signs=_VECTOR,
        read=lambda s: s.gravity,
    ),
    "joint_position": _term(
        about="q minus the pose at action 0", size="joints", signs="joints", read=lambda s: single(s.q) - single(s.pose)
    ),
    "absolute_joint_position": _term(about="q", size="joints", signs="joints", read=lambda s: s.q),
    "joint_velocity": _term(about="dq", size="joints", signs="joints", scale=0.05, read=lambda s: s.dq),
    "last_action": _term(about="last action", size="joints", signs="joints", read=lambda s: s.action),
    "command": _term(
        about="commands: " + ", ".join(COMMAND_NAMES),
        size=len(COMMAND_NAMES),
        signs=tuple(COMMAND_SIGNS.tolist()),
        scale=tuple(_COMMAND_SCALES[name] for name in COMMAND_NAMES),
        read=lambda s: s.command,
    ),
    "gait": _term(
        about="1 for the gait, else 0: " + ", ".join(gait.label for gait in Gait),
        size=len(Gait),
        signs="gaits",
        read=lambda s: namespace(s.gait).stack([s.gait == int(gait) for gait in Gait], 1),
    ),
    "foot_sin": _term(
        about="sin(2 pi phase) of the left and the right foot",
        size=2,
        signs=(1.0,),
        sides=True,
        read=_wave("sin", lambda s: s.feet),
    ),
    "foot_cos": _term(
        about="cos(2 pi phase) of the left and the right foot",
        size=2,
        signs=(1.0,),
        sides=True,
        read=_wave("cos", lambda s: s.feet),
    ),
    "intervention": _term(
        about="1 where the arms are under external control",
        size=1,
        signs=(1.0,),
        read=lambda s: s.indicator[:, None],
    ),
    "phase_sin": _term(
        about="sin(2 pi phase) of the clock",
        size=1,
        signs=(1.0,),
        read=_wave("sin", lambda s: s.phase[:, None]),
    ),
    "phase_cos": _term(
        about="cos(2 pi phase) of the clock",
        size=1,
        signs=(1.0,),
        read=_wave("cos", lambda s: s.phase[:, None]),
    ),
}
"""All terms, by name. The paper's policy has one clock per foot, which cannot tell phi from 0.5 - phi; ours reads sine
and cosine, and one number for each gait instead of the paper's psi, with which a jump looks like a hop."""


# Layout ---------------------------------------------------------------------------------------------------------------
# What the networks read and return, part by part, and the sizes that follow.

HISTORY_FRAMES = 5
TERRAIN_SHAPE = (17, 13)  # samples along x and y of the heading frame
TERRAIN_SPACING = 0.07  # [m]
TERRAIN_SIZE = math.prod(TERRAIN_SHAPE)

LENGTH_SCALE = 5.0

FRAME_TERMS = ("angular_velocity", "gravity", "joint_position", "joint_velocity", "last_action")
COMMAND_TERMS = ("command", "gait", "foot_sin", "foot_cos", "intervention")
FRAME = tuple(TERMS[name] for name in FRAME_TERMS)  # proprioception at one time
HISTORY = FRAME * HISTORY_FRAMES
COMMAND = tuple(TERMS[name] for name in COMMAND_TERMS)
ACTION = (Part("joint targets", "joints", "joints"),)
ESTIMATE = (
    Part("velocity of the pelvis in the heading frame [m/s]", 3, _VECTOR, scale=2.0),
    Part("clearance of the left and the right sole [m]", 2, (1.0,), sides=True, scale=LENGTH_SCALE),
    Part("pelvis height minus the nominal one [m]", 1, (1.0,), scale=LENGTH_SCALE),
)
ESTIMATE_SIZE = sum(int(part.size) for part in ESTIMATE)
PRIVILEGED = (  # what the critic sees besides frame, command and terrain
    Part("velocity of the pelvis in the heading frame [m/s]", 3, _VECTOR, scale=2.0),
    Part("measured minus commanded height [m]", 1, (1.0,), scale=LENGTH_SCALE),
    Part("clearance of the left and the right sole [m]", 2, (1.0,), sides=True, scale=LENGTH_SCALE),
    Part("friction coefficient of the robot's geometry", 1, (1.0,)),
    Part("ground reaction on both feet in the heading frame [N]", 6, _VECTOR, sides=True, scale=0.002),
    Part("whether each of `Robot.contact_links` touches something", "links", "links"),
    Part("filtered errors of v_x, v_y [m/s] and omega [rad/s]", 3, (1.0, -1.0, -1.0), scale=5.0),
    Part("payload of the left and the right hand [kg]", 2, (1.0,), sides=True, scale=0.25),
    Part("force on the left and the right hand in the heading frame [N]", 6, _VECTOR, sides=True, scale=0.02),
    Part("force on the trunk in the heading frame [N]", 3, _VECTOR, scale=0.02),
    Part("mass of the robot, minus 1 of its description", 1, (1.0,), scale=5.0),
    Part("latency [s]", 1, (1.0,), scale=50.0),
)
CRITIC_CORE = (*FRAME, *COMMAND, *PRIVILEGED)  # what the critic sees, without further terms and terrain


# Terms of the user ----------------------------------------------------------------------------------------------------


def further_terms(names: Sequence[str], robot: Robot) -> tuple[ObservationTerm, ...]:
    """Return terms that a training reads besides those of the paper, after trying each of them.

    Raises:
        UnknownNameError: if there is no such term.
        ConfigError: if one is named twice, fails `check_term`, or reads the velocity.
    """
    for name in names:
        if name not in TERMS:
            raise UnknownNameError("observation term", name, TERMS)
        if list(names).count(name) > 1:
            raise ConfigError(f"observation terms are {', '.join(names)}; give each once")
        check_term(name, robot)
        unknown = dataclasses.replace(_made_up(robot), velocity=np.full((_ROWS, 3), math.nan))
        if not np.isfinite(TERMS[name].read(unknown)).all():
            raise ConfigError(f"observation term '{name}' reads the velocity, which no sensor gives; leave it out")
    return tuple(TERMS[name] for name in names)


def check_term(name: str, robot: Robot) -> None:
    """Raise ConfigError if a term violates its declaration on random robots, their mirror images or a single robot."""
    term, robots = TERMS[name], _made_up(robot)
    (partner, sign), size = term.image(robot), term.count(robot)
    if len(partner) != size or not np.isin(sign, (-1.0, 1.0)).all() or len(sign) != size:
        raise ConfigError(f"observation term '{name}' has the size {size} and other signs; give +1 or -1 for each")
    straight, mirrored, alone = (
        np.asarray(term.read(s), dtype=float) for s in (robots, robots.mirrored(robot), robots.row(3))
    )
    if straight.shape != (_ROWS, size) or alone.shape != (1, size):
        raise ConfigError(f"observation term '{name}' gives shape {straight.shape}; give {(_ROWS, size)} here")
    if not np.isfinite(np.concatenate((straight, mirrored))).all():
        raise ConfigError(f"observation term '{name}' gives numbers that are not finite; give finite ones")
    if _differ(alone, straight[3:4]).any():
        raise ConfigError(f"observation term '{name}' mixes robots; compute each row from the same row alone")
    wrong = np.flatnonzero(_differ(mirrored, straight[:, partner] * sign).any(0))
    if wrong.size:
        raise ConfigError(
            f"observation term '{name}' violates its mirror signs at {', '.join(map(str, wrong))}, counted from 0; a "
            "left-right quantity needs -1, a vector's y as well, and pairs of sides need sides=True"
        )


def _differ(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    return np.abs(found - expected) > _TOLERANCE * np.maximum(1.0, np.abs(expected))


@functools.cache
def _made_up(robot: Robot) -> Sensed:
    """Return robots in random states and in every gait, with commands within their initial ranges."""
    rng, joints = np.random.default_rng(_SEED), len(robot.joint_names)
    ranges = command_ranges(Gait.WALKING, robot)
    low, high = np.array([ranges[name].initial for name in COMMAND_NAMES]).T
    gravity = np.array([0.0, 0.0, -1.0]) + 0.3 * rng.standard_normal((_ROWS, 3))
    return Sensed(
        angular_velocity=rng.standard_normal((_ROWS, 3)),
        gravity=gravity / np.linalg.norm(gravity, axis=1, keepdims=True),
        q=robot.nominal + 0.3 * rng.standard_normal((_ROWS, joints)),
        dq=2.0 * rng.standard_normal((_ROWS, joints)),
        action=rng.standard_normal((_ROWS, joints)),
        command=rng.uniform(low, high, (_ROWS, len(COMMAND_NAMES))),
        gait=np.arange(_ROWS) % len(Gait),
        phase=rng.uniform(0.0, 1.0, _ROWS),
        indicator=rng.uniform(0.0, 1.0, _ROWS) < 0.5,
        pose=robot.nominal,
        velocity=rng.standard_normal((_ROWS, 3)),
    )
