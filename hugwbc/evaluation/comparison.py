"""One script played with several controllers, hand targets solved by IK, and how each did."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.runtime.estimation import StateEstimator
from hugwbc.runtime.loop import upper_body_source
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.script import Script
from hugwbc.sim import Simulation, noisy_simulation


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How one controller did.

    Attributes:
        fell: whether the robot fell.
        survived_s: time until then, or the whole script [s].
        errors: mean absolute error of v_x, v_y, omega, h, p, w over all control steps, ramps included.
        hand_error_m: `metrics.HandErrors` [m].
        tick_ms: p50 and p99 of the controller's time for one call [ms].
        ik_ms: the same of the IK; None where it was not called.
        steps: control steps executed.
        footsteps: touch-downs of both feet.
        safety: what the safety filter changed.
    """

    fell: bool
    survived_s: float
    errors: dict[str, float]
    hand_error_m: dict[str, float | None]
    tick_ms: dict[str, float | None]
    ik_ms: dict[str, float | None]
    steps: int
    footsteps: int
    safety: dict[str, Any]


def summarise(trace: Trace) -> Outcome:
    """The figures of one run."""
    return Outcome(
        fell=trace.fell,
        survived_s=trace.survived_s,
        errors=metrics.tracking_errors(trace, settle=0.0),
        hand_error_m=dataclasses.asdict(metrics.hand_errors(trace.hand_error, trace.reachable)),
        tick_ms=metrics.percentiles(trace.tick_ms),
        ik_ms=metrics.percentiles(trace.ik_ms),
        steps=trace.steps,
        footsteps=sum(times.size for times in trace.touch_downs),
        safety=dataclasses.asdict(trace.safety),
    )


def check_names(controllers: Sequence[Controller]) -> None:
    """Refuse controllers whose runs nobody could tell apart.

    Raises:
        ConfigError: if there is no controller, or two have the same name.
    """
    names = [controller.name for controller in controllers]
    if not names or len(set(names)) < len(names):
        raise ConfigError(f"controllers are {names}; give at least one, each once")


def compare(
    controllers: Sequence[Controller],
    script: Script,
    *,
    seed: int = 0,
    noise: bool = False,
    on_progress: Callable[[float], None] | None = None,
) -> list[Trace]:
    """Play a script with each controller in turn, in the same simulation.

    Args:
        controllers: at least one; their names must differ.
        script: commands and hand targets.
        seed: of the sensor noise.
        noise: whether sensors have a real robot's noise and latency, and the state is estimated from them; without it
            nothing is random and the state is true.
        on_progress: called with the fraction done.

    Raises:
        ConfigError: if there is no controller, or two have the same name.
    """
    check_names(controllers)
    traces = []
    for index, controller in enumerate(controllers):
        simulation = noisy_simulation(seed=seed) if noise else Simulation()

        def advance(fraction: float, done: int = index) -> None:
            if on_progress is not None:
                on_progress((done + fraction) / len(controllers))

        traces.append(
            rollout(
                controller,
                script,
                simulation,
                upper_body_source(controller),
                duration=script.duration,
                estimator=StateEstimator() if noise else None,
                on_progress=advance,
            )
        )
    return traces
