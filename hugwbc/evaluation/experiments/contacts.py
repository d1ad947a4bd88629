"""The paper's figure of gaits: when each foot is on the ground, how well that fits the clock, and what it costs."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import polars as pl

from hugwbc import gait as gaits
from hugwbc.controller import Controller
from hugwbc.evaluation import metrics
from hugwbc.evaluation.episode import CountedSettings, Row, ending, simulate
from hugwbc.evaluation.experiment import Experiment, Measured, Section
from hugwbc.evaluation.figures import FALLS, Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, known
from hugwbc.evaluation.plans import Plan
from hugwbc.gait import Gait
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.settings import NotNegative, Positive, settings
from hugwbc.viz import evaluation_plots
from hugwbc.viz.plots import Panel

V_X = 0.5  # [m/s]
_CLOCK = "Contacts that agree with the clock"
_OFFSETS = np.arange(100) / 100.0  # [cycles] of the clock, tried in turn
_SHOWN_S = 2.0  # [s] of a gait diagram


@settings(kw_only=True)
class ContactsSettings(CountedSettings):
    """Settings of contacts."""

    duration: Positive = 6.0  # duration of an episode [s]
    settle: NotNegative = 3.0  # start of an episode that is left out of the figures [s]


def plan(settings: ContactsSettings) -> list[Plan]:
    """Return the default command of the gait for every episode, at `V_X` if the gait moves."""
    v_x = 0.0 if settings.gait == Gait.STANDING.label else V_X
    draws = range(settings.episodes)
    return [Plan(draw, dataclasses.replace(settings.default_command(draw), v_x=v_x)) for draw in draws]


def episode(controller: Controller, settings: ContactsSettings, plan: Plan) -> Row:
    """Return the contacts of both feet after the settling time, and how well the clock fits them.

    - `left`, `right`: whether the foot is on the ground, 1 or 0, every `RECORD_PERIOD`.
    - `offset`: phase of the clock at the first sample that agrees best [cycles]; every controller starts its clock when
      it is ready. `agreement`: part of all samples of both feet in which contact and clock agree.
    - `cost_of_transport`: see `metrics.cost_of_transport`; None on the spot and after a fall.
    """
    trace, command = simulate(controller, settings, plan), plan.command
    contact = trace.foot_contact[trace.time >= settings.settle - 1e-9]
    offset, agreement = fit_clock(contact, command.gait, command.f) if len(contact) else (0.0, None)
    carried = settings.conditions.payload + 2.0 * settings.conditions.hand_payload
    cost = metrics.cost_of_transport(trace, trace.mass + carried, settings.settle)
    return {
        "gait": command.gait.label,
        "frequency": command.f,
        "left": contact[:, 0].astype(int).tolist(),
        "right": contact[:, 1].astype(int).tolist(),
        "offset": offset,
        "agreement": agreement,
        "cost_of_transport": None if trace.down else known(cost),
        **ending(trace),
    }


def clock_phases(gait: Gait, frequency: float, offset: float, samples: int) -> np.ndarray:
    """Return the phases of both feet at the samples of an episode, shape (samples, 2)."""
    phase = gaits.advance_phase(np.full(samples, offset), frequency * np.arange(samples), RECORD_PERIOD)
    return gaits.foot_phases(phase, np.full(samples, int(gait)))


def fit_clock(contact: np.ndarray, gait: Gait, frequency: float) -> tuple[float, float]:
    """Return the clock's offset [cycles] that agrees best with contacts (T, 2), and the part of samples that agree."""
    # A foot should be on the ground in the first half of its cycle.
    stance = [clock_phases(gait, frequency, offset, len(contact)) < 0.5 for offset in _OFFSETS]
    agreement = [float(np.mean(expected == contact)) for expected in stance]
    best = int(np.argmax(agreement))
    return float(_OFFSETS[best]), agreement[best]


def figures(settings: ContactsSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return how much of the time contacts agree with the clock and each foot stands, cost of transport, and falls."""
    gait = settings.gait.replace("_", " ")
    agreement = bootstrap_mean([None if part is None else 100.0 * part for part in rows["agreement"]])
    table, found = f"Contacts, {gait}", []
    found.append(Figure(_CLOCK, gait, "%", agreement, higher_is_better=True))
    found.append(falls_figure(_CLOCK, rows["fell"], quantity=f"{FALLS}, {gait}"))
    for side in ("left", "right"):
        stance = bootstrap_mean([100.0 * sum(foot) / len(foot) if len(foot) else None for foot in rows[side]])
        found.append(Figure(table, f"{side} foot on the ground, of the time", "%", stance, higher_is_better=None))
    cost = bootstrap_mean(rows["cost_of_transport"])
    found += [Figure(table, "cost of transport", "", cost)] if cost.value is not None else []
    return [*found, falls_figure(table, rows["fell"])]


def pictures(measured: Sequence[Measured], controllers: Sequence[str]) -> list[Panel]:
    """Return contacts and clock of the first episode of each gait and controller."""
    drawn = []
    for controller, _, rows in measured:
        row = rows.row(0, named=True)
        contact = np.array([row["left"], row["right"]], dtype=bool).T[: round(_SHOWN_S / RECORD_PERIOD)]
        title = f"{row['gait']}, {controller}{' (fell)' if row['fell'] else ''}".replace("_", " ")
        if len(contact):
            clock = gaits.clock(clock_phases(Gait.parse(row["gait"]), row["frequency"], row["offset"], len(contact)))
            time = RECORD_PERIOD * np.arange(len(contact))
            number = list(controllers).index(controller)
            drawn.append(evaluation_plots.gait_diagram(title, time, contact, clock, number, _SHOWN_S))
    return drawn


def every_gait() -> list[ContactsSettings]:
    """Return one episode of every gait; more would show the same."""
    return [ContactsSettings(gait=gait.label) for gait in Gait]


EXPERIMENT = Experiment(
    "contacts",
    "contacts of the feet against the clock of the gait, and the cost of transport",
    ContactsSettings,
    plan,
    episode,
    figures,
    section=Section(
        "Contacts",
        "When each foot is on the ground (bars) and the clock of the commanded gait (curves: high in stance). The "
        "clock is shifted in time to where it agrees best, as every controller starts it when it is ready. Cost of "
        "transport: the joints' mechanical power over weight times speed; braking costs as much as driving.",
        every_gait,
        every_gait,
        pictures,
    ),
)
