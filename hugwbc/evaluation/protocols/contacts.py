"""The paper's figure of gaits: when each foot is on the ground, and how well that agrees with the clock."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc import gait as gaits
from hugwbc.commands import Command, default_command
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import bootstrap_mean
from hugwbc.evaluation.picture_data import GaitDiagram
from hugwbc.evaluation.protocols.episodes import CountedResult, CountedSettings, Run, SettledJudge
from hugwbc.evaluation.protocols.protocol import Measured, PlannedProtocol, count_text, failure_lines
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait
from hugwbc.runtime.trace import RECORD_PERIOD

_OFFSETS = np.arange(100) / 100.0  # [cycles] of the clock, tried in turn
_SHOWN_S = 2.0  # [s] of a gait diagram


@dataclasses.dataclass(frozen=True)
class ContactsConfig(CountedSettings):
    """Settings of the contacts protocol, in addition to `CountedSettings`.

    Attributes:
        episodes: number of episodes; they differ only where ground, sensors or arms are random.
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
        """Return the default command of a gait, with the forward velocity if the gait moves."""
        return dataclasses.replace(default_command(gait), v_x=0.0 if gait is Gait.STANDING else self.v_x)


@dataclasses.dataclass(frozen=True)
class ContactsEpisode:
    """One episode, after its settling time.

    Attributes:
        gait: label of the gait.
        frequency: commanded stride frequency [Hz].
        left, right: whether the foot is on the ground, 1 or 0, every `RECORD_PERIOD`.
        offset: phase of the commanded clock at the first sample that agrees best with the contacts [cycles]; every
            controller starts its clock when it is ready.
        agreement: fraction of all samples of both feet in which contact and clock agree; None if the robot fell
            before the settling time.
        fell: whether the robot fell.
        failures: number of exceptions of the controller that the safety filter caught.
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
    """Result of the contacts protocol."""


def clock_phases(gait: Gait, frequency: float, offset: float, samples: int) -> np.ndarray:
    """Return the homogenised phases of both feet at the samples of an episode, shape (samples, 2)."""
    phase = gaits.advance_phase(np.full(samples, offset), frequency * np.arange(samples), RECORD_PERIOD)
    return gaits.homogenised_phase(gaits.foot_phases(phase, np.full(samples, int(gait))))


def fit_clock(contact: np.ndarray, gait: Gait, frequency: float) -> tuple[float, float]:
    """Fit the clock to the contacts, shape (T, 2).

    Returns:
        The offset [cycles] that agrees best with the contacts, and the fraction of samples in which it does.
    """
    # A foot should be on the ground in the first half of its homogenised cycle.
    stance = [clock_phases(gait, frequency, offset, len(contact)) < 0.5 for offset in _OFFSETS]
    agreement = [float(np.mean(expected == contact)) for expected in stance]
    best = int(np.argmax(agreement))
    return float(_OFFSETS[best]), agreement[best]


class ContactsJudge(SettledJudge):
    """Judge that keeps the contacts of an episode."""

    def __call__(self, index: int, run: Run) -> ContactsEpisode:
        """Return the row of one episode."""
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


class ContactsProtocol(PlannedProtocol[ContactsConfig, ContactsEpisode, ContactsResult]):
    """The contacts of the feet against the clock of the gait."""

    name = "contacts"
    summary = "contacts of the feet against the clock of the gait"
    settings = ContactsConfig
    result = ContactsResult
    report_title = "Contacts"
    report_text = (
        "When each foot is on the ground (bars) and the clock of the commanded gait (curves: high in stance). The "
        "clock is shifted in time to where it agrees best, as every controller starts it when it is ready."
    )

    def plans(self, settings: ContactsConfig) -> list[EpisodePlan]:
        """Return the same command for every episode."""
        return [EpisodePlan(settings.command(settings.alternating[i % 2])) for i in range(settings.episodes)]

    def judge(self, settings: ContactsConfig) -> ContactsJudge:
        """Return what keeps the contacts."""
        return ContactsJudge(settings.settle)

    def summarise(self, settings: ContactsConfig, rows: Sequence[ContactsEpisode]) -> dict[str, Any]:
        """Return nothing: the rows say all."""
        return {}

    def describe(self, result: ContactsResult) -> str:
        """Return the agreement of contacts and clock, and the fraction of time that each foot is on the ground."""
        rows: list[tuple[object, ...]] = []
        for index, row in enumerate(result.rows):
            stance = [sum(foot) / len(foot) if foot else None for foot in (row.left, row.right)]
            rows.append((f"episode {index + 1}", row.agreement, *stance))
        columns = ("contacts as the clock", "left on the ground", "right on the ground")
        table = format_table((f"{result.gait}, part of the time", *columns), rows)
        falls = f"falls: {count_text(result.falls, result.episodes)}"
        return "\n".join([table, "", falls, *failure_lines(result.rows)])

    def quick(self) -> list[ContactsConfig]:
        """Return one episode of every gait."""
        return [ContactsConfig(gait) for gait in Gait]

    def full(self) -> list[ContactsConfig]:
        """Return one episode of every gait; more would show the same."""
        return self.quick()

    def figures(self, controller: str, result: Mapping[str, Any]) -> list[Figure]:
        """Return the percentage of time in which each foot does what the clock says."""
        parts = [None if row["agreement"] is None else 100.0 * row["agreement"] for row in result["rows"]]
        table, quantity = "Contacts that agree with the clock", str(result["gait"]).replace("_", " ")
        return [Figure(table, quantity, "%", controller, bootstrap_mean(parts), higher_is_better=True)]

    def pictures(self, measured: Sequence[Measured], controllers: Sequence[str]) -> list[GaitDiagram]:
        """Return contacts and clock of the first episode of each gait and controller."""
        pictures = []
        for controller, result in measured:
            row: Mapping[str, Any] = result["rows"][0]
            contact = np.array([row["left"], row["right"]], dtype=bool).T[: round(_SHOWN_S / RECORD_PERIOD)]
            title = f"{row['gait']}, {controller}{' (fell)' if row['fell'] else ''}".replace("_", " ")
            if not len(contact):
                continue
            clock = gaits.clock(clock_phases(Gait.parse(row["gait"]), row["frequency"], row["offset"], len(contact)))
            time = RECORD_PERIOD * np.arange(len(contact))
            pictures.append(GaitDiagram(title, time, contact, clock, controller, _SHOWN_S))
        return pictures
