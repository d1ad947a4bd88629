"""Observation terms that other packages register: further numbers that a policy reads, made of what it senses.

A term is an entry point in the group `hugwbc.observations` that names an `ObservationTerm`. It declares size, scale,
noise and mirror image in one place; networks, mirror maps, contracts and self-tests follow. Its numbers come after
those of the command, and the critic sees them as well. Nothing here needs torch.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint

import numpy as np

from hugwbc import gait as gaits
from hugwbc.commands import COMMAND_NAMES, command_ranges
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.extensions import described, load_entry, registered
from hugwbc.gait import Gait
from hugwbc.learned.policy.layout import FRAME, JOINTS, Part
from hugwbc.mirror import AXIAL_SIGNS, COMMAND_SIGNS, VECTOR_SIGNS, load_mirror
from hugwbc.robot import load_robot

GROUP, KIND = "hugwbc.observations", "observation term"
LARGEST = 100.0  # of a scaled number; what is beyond it is clamped
_ROWS, _SEED = 64, 0  # of the made-up rows on which terms are tried
_TOLERANCE = 1e-4  # of a mirror image, relative to the larger of 1 and the number


@dataclasses.dataclass(frozen=True, eq=False)
class Sensed:
    """What n robots sense and are told, as terms read it; in training, with the errors of the sensors.

    Attributes:
        angular_velocity: of the pelvis in its own frame [rad/s], shape (n, 3).
        gravity: unit vector of gravity in the pelvis frame, shape (n, 3).
        q, dq: joint positions [rad] and velocities [rad/s], shape (n, 19).
        action: the policy's last output, shape (n, 19).
        command: in the order of `COMMAND_NAMES`, shape (n, 8).
        gait: values of `Gait`, shape (n,).
        phases: homogenised phases of the left and the right foot, shape (n, 2).
        indicator: whether the arms are under external control, shape (n,), bool.
    """

    angular_velocity: np.ndarray
    gravity: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    action: np.ndarray
    command: np.ndarray
    gait: np.ndarray
    phases: np.ndarray
    indicator: np.ndarray

    @classmethod
    def of_frame(cls, frame: np.ndarray, nominal: np.ndarray, **told: np.ndarray) -> "Sensed":
        """Read the newest frames of proprioception, shape (n, 63).

        Args:
            frame: the frames, as the network reads them.
            nominal: nominal joint positions [rad], shape (19,).
            told: the attributes that a frame does not tell.
        """
        ends = np.cumsum([part.size for part in FRAME])[:-1]
        values = np.split(frame.astype(float), ends, axis=1)
        omega, gravity, offset, dq, action = (v / part.scale for v, part in zip(values, FRAME, strict=True))
        return cls(omega, gravity, offset + nominal, dq, action, **told)

    def mirrored(self) -> "Sensed":
        """Return what the mirror images of the robots sense."""
        joints = load_mirror().joints
        return Sensed(
            self.angular_velocity * AXIAL_SIGNS,
            self.gravity * VECTOR_SIGNS,
            joints(self.q),
            joints(self.dq),
            joints(self.action),
            self.command * COMMAND_SIGNS,
            np.array([int(Gait(int(gait)).mirrored()) for gait in self.gait]),
            self.phases[:, ::-1],
            self.indicator,
        )

    def row(self, place: int) -> "Sensed":
        """Return one robot's, as n = 1."""
        fields = dataclasses.fields(self)
        return Sensed(**{field.name: getattr(self, field.name)[place : place + 1] for field in fields})


@dataclasses.dataclass(frozen=True, kw_only=True)
class ObservationTerm(Part):
    """A term: what `Part` declares, and how it is made.

    Attributes:
        read: returns the numbers in physical units, shape (n, size), each row of the same row of `Sensed` alone. It
            keeps nothing between calls.
    """

    read: Callable[[Sensed], np.ndarray]

    def observed(self, sensed: Sensed) -> np.ndarray:
        """Return the numbers as the network reads them, shape (n, size), float32; what is not finite becomes 0."""
        value = np.nan_to_num(self.scale * np.asarray(self.read(sensed)), posinf=LARGEST, neginf=-LARGEST)
        return np.clip(value, -LARGEST, LARGEST).astype(np.float32)


@functools.cache
def registered_terms() -> dict[str, EntryPoint]:
    """Return the registered terms by name; nothing is loaded.

    Raises:
        ConfigError: if a name stands for two terms.
    """
    return registered(GROUP, KIND)


def check_names(names: Sequence[str]) -> None:
    """Refuse names of terms that no package registers, and names that are given twice.

    Raises:
        UnknownNameError: if there is no such term.
        ConfigError: if a name is given twice.
    """
    for name in names:
        if name not in registered_terms():
            raise UnknownNameError(KIND, name, registered_terms() or ["none: no package with terms is installed"])
    if len(set(names)) < len(names):
        raise ConfigError(f"observation terms are {', '.join(names)}; give each once")


def own_terms(names: Sequence[str]) -> tuple[ObservationTerm, ...]:
    """Return terms by name, in order, after trying each of them.

    Raises:
        UnknownNameError: if there is no such term.
        ConfigError: if one cannot be loaded, or does not work.
    """
    check_names(names)
    return tuple(_term(name) for name in names)


def own_columns(terms: Sequence[ObservationTerm], sensed: Sensed) -> np.ndarray:
    """Return the numbers of terms side by side, shape (n, sum of sizes), float32."""
    return np.concatenate([term.observed(sensed) for term in terms], axis=1)


@functools.cache
def _term(name: str) -> ObservationTerm:
    entry = registered_terms()[name]
    term, origin = load_entry(entry, KIND), f"{KIND} '{name}' ({entry.value})"
    if not isinstance(term, ObservationTerm):
        raise ConfigError(f"{origin} is a {type(term).__name__}; register an ObservationTerm")
    _check_declaration(term, origin)
    _check_values(term, origin)
    return term


def _check_declaration(term: ObservationTerm, origin: str) -> None:
    if type(term.size) is not int or term.size < 1:
        raise ConfigError(f"{origin} has the size {term.size!r}; give a whole number of at least 1")
    if not (np.isfinite(term.scale) and term.scale > 0.0 and np.isfinite(term.noise) and term.noise >= 0.0):
        raise ConfigError(
            f"{origin} has scale {term.scale} and noise {term.noise}; give a scale above 0, a noise from 0"
        )
    if term.signs == "joints" and not term.sides:
        signs = JOINTS
    elif isinstance(term.signs, str) or not all(abs(sign) == 1.0 for sign in term.signs):
        raise ConfigError(
            f"{origin} has the signs {term.signs!r}; give +1 or -1 for each number, so that the mirror image of the "
            "mirror image is the observation itself, or 'joints'"
        )
    else:
        signs = len(term.signs) * (2 if term.sides else 1)
    if signs != term.size:
        raise ConfigError(f"{origin} has signs for {signs} numbers and the size {term.size}; give one sign per number")


def _check_values(term: ObservationTerm, origin: str) -> None:
    """Try a term on made-up rows: shape, finite numbers, rows of their own, and the mirror image that it declares."""
    sensed = _made_up()
    values = []
    for rows in (sensed, sensed.mirrored(), sensed.row(3)):
        try:
            value = term.read(rows)
        except Exception as error:  # the code of another package may raise anything
            raise ConfigError(f"{origin} fails: {described(error)}") from error
        count = len(rows.gait)
        if not isinstance(value, np.ndarray) or value.shape != (count, term.size):
            found = f"shape {value.shape}" if isinstance(value, np.ndarray) else f"a {type(value).__name__}"
            raise ConfigError(f"{origin} gives {found}; give an array, here ({count}, {term.size})")
        if not np.issubdtype(value.dtype, np.number) or not np.all(np.isfinite(value)):
            raise ConfigError(f"{origin} gives numbers that are not finite; give finite ones for any finite input")
        values.append(value)
    straight, mirrored, alone = values
    partner, sign = term.image()
    if _differ(alone, straight[3:4]).any():
        raise ConfigError(f"{origin} gives a robot alone other numbers than among others; compute each row by itself")
    wrong = np.flatnonzero(_differ(mirrored, straight[:, partner] * sign).any(0))
    if wrong.size:
        numbers = ", ".join(map(str, wrong))
        raise ConfigError(
            f"{origin} gives a mirrored robot not the mirror image that its signs declare: see its number {numbers}, "
            "counted from 0; a left-right quantity needs -1, a vector's y as well, and pairs of sides need sides=True"
        )


def _differ(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    return np.abs(found - expected) > _TOLERANCE * np.maximum(1.0, np.abs(expected))


@functools.cache
def _made_up() -> Sensed:
    """Return robots in random states under commands over their ranges, in every gait."""
    rng, robot = np.random.default_rng(_SEED), load_robot()
    gait = np.arange(_ROWS) % len(Gait)
    ranges = command_ranges(Gait.WALKING)
    low, high = np.array([ranges[name].initial for name in COMMAND_NAMES]).T
    gravity = np.array([0.0, 0.0, -1.0]) + 0.3 * rng.standard_normal((_ROWS, 3))
    return Sensed(
        angular_velocity=rng.standard_normal((_ROWS, 3)),
        gravity=gravity / np.linalg.norm(gravity, axis=1, keepdims=True),
        q=robot.nominal + 0.3 * rng.standard_normal((_ROWS, JOINTS)),
        dq=2.0 * rng.standard_normal((_ROWS, JOINTS)),
        action=rng.standard_normal((_ROWS, JOINTS)),
        command=rng.uniform(low, high, (_ROWS, len(COMMAND_NAMES))),
        gait=gait,
        phases=gaits.homogenised_phase(gaits.foot_phases(rng.uniform(0.0, 1.0, _ROWS), gait)),
        indicator=rng.uniform(0.0, 1.0, _ROWS) < 0.5,
    )
