"""When each foot is on the ground in a gait, and how well that agrees with the clock: the paper's figure of gaits."""

import dataclasses
from collections.abc import Callable

import numpy as np

from hugwbc import gait as gaits
from hugwbc.commands import Command, default_command
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.protocols.episodes import ControllerFactory, CountedResult, CountedSettings, Run, run_episodes
from hugwbc.gait import Gait
from hugwbc.runtime.trace import RECORD_PERIOD

_OFFSETS = np.arange(100) / 100.0  # [cycles] of the clock, tried in turn


@dataclasses.dataclass(frozen=True)
class ContactsConfig(CountedSettings):
    """Settings of the protocol, beside those of any of one gait.

    Attributes:
        episodes: how many; they differ where ground, sensors or arms are random.
        v_x: forward velocity of gaits that move [m/s].
    """

    episodes: int = 1
    _: dataclasses.KW_ONLY
    v_x: float = 0.5
    duration: float = 6.0
    settle: float = 3.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.command(self.gait).validate()

    def command(self, gait: Gait) -> Command:
        """Of an episode in a gait: at its defaults, but for the velocity of one that moves."""
        return dataclasses.replace(default_command(gait), v_x=0.0 if gait is Gait.STANDING else self.v_x)


@dataclasses.dataclass(frozen=True)
class ContactsEpisode:
    """One episode, after its settling time.

    Attributes:
        gait: label.
        frequency: commanded stride frequency [Hz].
        left, right: whether the foot is on the ground, 1 or 0, every `RECORD_PERIOD`.
        offset: of the commanded clock's phase at the first sample, such that it agrees best with the contacts: a
            controller starts its clock when it is ready to [cycles].
        agreement: part of the time and feet in which contact and clock say the same; None if the robot fell before.
        fell: whether the robot fell.
        failures: exceptions of the controller that the safety filter caught.
    """

    gait: str
    frequency: float
    left: tuple[int, ...]
    right: tuple[int, ...]
    offset: float
    agreement: float | None
    fell: bool
    failures: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class ContactsResult(CountedResult[ContactsEpisode]):
    """Outcome of the protocol."""


def clock_phases(gait: Gait, frequency: float, offset: float, samples: int) -> np.ndarray:
    """Homogenised phases of both feet at the samples of an episode, shape (samples, 2)."""
    phase = gaits.advance_phase(np.full(samples, offset), frequency * np.arange(samples), RECORD_PERIOD)
    return gaits.homogenised_phase(gaits.foot_phases(phase, np.full(samples, int(gait))))


def fit_clock(contact: np.ndarray, gait: Gait, frequency: float) -> tuple[float, float]:
    """Offset of the clock that agrees best with the contacts, shape (T, 2), and in what part of the samples it does."""
    stance = [clock_phases(gait, frequency, offset, len(contact)) < 0.5 for offset in _OFFSETS]
    agreement = [float(np.mean(expected == contact)) for expected in stance]
    best = int(np.argmax(agreement))
    return float(_OFFSETS[best]), agreement[best]


def run_contacts(
    factory: ControllerFactory, config: ContactsConfig, on_episode: Callable[[ContactsEpisode], None] | None = None
) -> ContactsResult:
    """Run the protocol.

    Args:
        factory: makes the controller; with more than one worker it must be picklable.
        config: settings.
        on_episode: called with every finished episode, in order.
    """
    plans = [EpisodePlan(config.command(config.alternating[index % 2])) for index in range(config.episodes)]
    rows = run_episodes(factory, plans, ContactsJudge(config.settle), config, on_episode)
    return ContactsResult.of(factory, config, rows)


@dataclasses.dataclass(frozen=True)
class ContactsJudge:
    """Keeps the contacts of an episode.

    Attributes:
        settle: start of the episode that is left out [s].
    """

    settle: float

    def __call__(self, index: int, run: Run) -> ContactsEpisode:
        """The row of one episode."""
        contact = run.trace.foot_contact[run.trace.time >= self.settle - 1e-9]
        command = run.command
        offset, agreement = fit_clock(contact, command.gait, command.f) if len(contact) else (0.0, None)
        return ContactsEpisode(
            gait=command.gait.label,
            frequency=command.f,
            left=tuple(contact[:, 0].astype(int).tolist()),
            right=tuple(contact[:, 1].astype(int).tolist()),
            offset=offset,
            agreement=agreement,
            fell=run.trace.fell,
            failures=run.trace.safety.failures,
        )
