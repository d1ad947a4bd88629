"""How closely the hands follow their targets in closed loop, standing or walking, with any controller."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import UpperBody
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.intervals import Estimate, bootstrap_mean, wilson_of
from hugwbc.evaluation.protocols.episodes import ControllerFactory, CountedSettings, ProtocolResult, known, mean
from hugwbc.evaluation.protocols.protocol import INTERVAL, INTERVAL_NOTE, Protocol, count_text, interval_text
from hugwbc.evaluation.tables import format_table, hand_rows
from hugwbc.gait import Gait
from hugwbc.robot import Robot, load_robot
from hugwbc.runtime.loop import ArmSource
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import RECORD_PERIOD, Trace
from hugwbc.scripts.hand_paths import Line
from hugwbc.scripts.script import DEFAULT_RAMP, HandMotion, Script, Segment
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import ArmIK, IKSolution, UpperBodySource

# Targets of the left hand in the pelvis frame [m]; the right hand's are drawn from the mirror image.
LOW, HIGH = np.array([0.15, 0.08, -0.05]), np.array([0.48, 0.50, 0.55])
LEG_TIME, DWELL = 1.2, 0.8  # [s] from target to target, and at each
REACHED = 0.005  # [m]
_AVERAGED = ("hand_error_m", "hand_error_all_m", "joint_error_rad")  # means over episodes that get an interval
SATURATED = 0.99  # of a joint's torque limit
STANDING_START = 1.0  # [s] before a walk


@dataclasses.dataclass(frozen=True)
class HandsConfig(CountedSettings):
    """Settings of the hands protocol, in addition to `CountedSettings`.

    Attributes:
        episodes: number of episodes, each with its own targets.
        v_x: forward velocity of gaits that move [m/s].
        settle: start of an episode that is left out of the errors, in which the arms are taken over [s].
    """

    episodes: int = 8
    _: dataclasses.KW_ONLY
    v_x: float = 0.5
    settle: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gait is not Gait.STANDING:
            Command(v_x=self.v_x, gait=self.gait).validate()
            if not self.duration > STANDING_START + DEFAULT_RAMP:
                raise ConfigError(
                    f"duration is {self.duration} s; give more than {STANDING_START + DEFAULT_RAMP:g} s, in which the "
                    f"{self.gait.label} gait gets going"
                )
        if self.conditions.intervention != "none":
            raise ConfigError("the hands protocol moves the arms itself; leave the intervention at none")


@dataclasses.dataclass(frozen=True)
class HandsEpisode:
    """One episode; the errors are None if the robot fell before the settling time.

    Attributes:
        hand_error_m: mean distance of both hands to the targets that the inverse kinematics calls reachable [m].
        hand_error_all_m: mean distance of both hands to all targets [m].
        reachable_fraction: fraction of the samples in which the inverse kinematics calls a target reachable.
        joint_error_rad: mean distance of the arm joints to the inverse kinematics' solution [rad].
        jitter: mean squared joint jerk of the commanded arms [rad^2/s^6].
        saturated_ticks: number of control steps with an arm joint at its torque limit.
        fell: whether the robot fell.
        survived_s: time until the fall, or the whole episode [s].
    """

    hand_error_m: float | None
    hand_error_all_m: float | None
    reachable_fraction: float | None
    joint_error_rad: float | None
    jitter: float | None
    saturated_ticks: int
    fell: bool
    survived_s: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class HandsResult(ProtocolResult[HandsEpisode]):
    """Result of the hands protocol, in addition to `ProtocolResult`.

    Attributes:
        v_x: forward velocity [m/s].
        hand_error_m: `metrics.HandErrors` of all episodes [m]: to the targets that the inverse kinematics calls
            reachable, and to all targets. All of them are reachable on a nominal body (`reachable_targets`).
        joint_error_rad: mean distance of the arm joints to the inverse kinematics' solution [rad].
        fell: number of episodes in which the robot fell.
        saturated_ticks: number of control steps with an arm joint at its torque limit.
        jitter: mean squared joint jerk of the commanded arms [rad^2/s^6].
        episodes: number of episodes.
        falls_interval: percentage of episodes in which the robot fell, with its score interval.
        intervals: means over the episodes of some of the rows' figures, with their intervals. An episode counts as one
            sample, whatever part of its targets is reachable; so the means may differ a little from those above.
    """

    v_x: float
    hand_error_m: dict[str, float | None]
    joint_error_rad: float | None
    fell: int
    saturated_ticks: int
    jitter: float | None
    episodes: int
    falls_interval: Estimate = dataclasses.field(init=False)
    intervals: dict[str, Estimate] = dataclasses.field(init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "falls_interval", wilson_of(self.fell, self.episodes))
        intervals = {name: bootstrap_mean(getattr(row, name) for row in self.rows) for name in _AVERAGED}
        object.__setattr__(self, "intervals", intervals)


class _Recording:
    """An upper-body source that records the solutions of another one's inverse kinematics, and its commands."""

    def __init__(self, source: ArmSource) -> None:
        self._source = source
        self.wanted: list[np.ndarray] = []
        self.commanded: list[np.ndarray] = []

    @property
    def solution(self) -> IKSolution | None:
        """The last solution of the source."""
        return self._source.solution

    def reset(self) -> None:
        """Reset the source."""
        self._source.reset()

    def update(
        self,
        state: RobotState,
        hands: HandTargets | None,
        command: Command,
        dt: float,
        commanded: np.ndarray | None = None,
    ) -> tuple[UpperBody, Command]:
        """Update the source and record its solution and its command."""
        body, command = self._source.update(state, hands, command, dt, commanded)
        nothing = np.full(8, np.nan)
        self.wanted.append(nothing if self.solution is None else self.solution.q)
        self.commanded.append(body.q if body.indicator else nothing)
        return body, command

    def sampled(self, rows: list[np.ndarray], period: float) -> np.ndarray:
        """Return the rows at the times of a trace, shape (samples, 8)."""
        return np.array(rows[:: max(1, round(RECORD_PERIOD / period))])


def reachable_targets(count: int, rng: np.random.Generator, robot: Robot) -> np.ndarray:
    """Draw pairs of hand targets in the pelvis frame that the arms reach on a nominal body [m], shape (count, 2, 3)."""
    state = RobotState(robot.nominal, np.zeros(19), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    ik, pairs = ArmIK(robot=robot), []
    while len(pairs) < count:
        pair = rng.uniform(LOW, HIGH, (2, 3)) * np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])
        ik.reset(robot.nominal[robot.arms])
        targets = HandTargets(pair[0], pair[1])
        # 100 steps of 20 ms let the inverse kinematics converge from the nominal posture.
        solutions = [ik.solve(targets, state, 0.02) for _ in range(100)]
        if np.all(solutions[-1].residual < REACHED):
            pairs.append(pair)
    return np.array(pairs)


def hands_script(config: HandsConfig, rng: np.random.Generator, index: int = 0) -> Script:
    """Script one episode: both hands go from one reachable target to the next while the robot stands or moves.

    Args:
        config: settings of the protocol.
        rng: draws the targets.
        index: number of the episode, which decides the leg where both legs take turns.
    """
    gait = config.alternating[index % 2]
    count = math.ceil(config.duration / (LEG_TIME + DWELL)) + 1
    pairs = reachable_targets(count, rng, config.conditions.told_arena.known_robot)
    left, right = (Line(tuple(tuple(p.tolist()) for p in pairs[:, hand]), LEG_TIME, DWELL) for hand in range(2))
    hands = HandMotion(left, right)
    if gait is Gait.STANDING:
        return Script("hands", (Segment("stand", config.duration, hands=hands, ramp=0.0),))
    walk = Segment("go", config.duration - STANDING_START, gait, {"v_x": config.v_x}, hands)
    return Script("hands", (Segment("stand", STANDING_START, hands=hands), walk))


def _judge(trace: Trace, source: _Recording, period: float, kept: np.ndarray, robot: Robot) -> HandsEpisode:
    arms = robot.arms
    wanted, commanded = (source.sampled(rows, period)[: kept.size] for rows in (source.wanted, source.commanded))
    limits = SATURATED * robot.torque_limit[arms]
    joint_error = np.abs(trace.qpos[:, 7:][:, arms] - wanted)[kept]
    hands = metrics.hand_errors(trace.hand_error[kept], trace.reachable[kept])
    return HandsEpisode(
        hand_error_m=hands.mean,
        hand_error_all_m=hands.all_mean,
        reachable_fraction=hands.reachable_fraction,
        joint_error_rad=_known_mean(joint_error[np.isfinite(joint_error)]),
        jitter=known(metrics.jitter(commanded[kept], RECORD_PERIOD)),
        saturated_ticks=int(np.any(np.abs(trace.torque[kept][:, arms]) >= limits, axis=1).sum()),
        fell=trace.fell,
        survived_s=trace.survived_s,
    )


def _known_mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if values.size else None


class HandsProtocol(Protocol[HandsConfig, HandsEpisode, HandsResult]):
    """The accuracy of the hands in closed loop; its episodes run in one process, and are not stored."""

    name = "hands"
    summary = "accuracy of the hands, moving from one reachable target to the next"
    settings = HandsConfig
    fixed = frozenset({"intervention", "motions"})  # the protocol moves the arms itself
    stores_episodes = False

    def run(
        self,
        factory: ControllerFactory,
        settings: HandsConfig,
        on_episode: Callable[[HandsEpisode], None] | None = None,
    ) -> HandsResult:
        """Run the episodes one after the other; arguments as in `Protocol`."""
        controller = factory()
        rows, errors, reachable = [], [], []
        for index in range(settings.episodes):
            seed = (settings.seed, index)
            script = hands_script(settings, np.random.default_rng(seed), index)
            source = _Recording(UpperBodySource(robot=settings.conditions.told_arena.known_robot))
            trace = rollout(
                controller,
                script,
                settings.conditions.simulation(settings.duration, seed),
                source,
                duration=settings.duration,
                estimator=settings.conditions.estimator(),
            )
            kept = trace.time >= settings.settle
            errors.append(trace.hand_error[kept])
            reachable.append(trace.reachable[kept])
            rows.append(_judge(trace, source, controller.period, kept, load_robot(settings.conditions.chosen.robot)))
            if on_episode is not None:
                on_episode(rows[-1])
        return HandsResult.of(
            lambda: controller,
            settings,
            rows,
            v_x=0.0 if settings.gait is Gait.STANDING else settings.v_x,
            hand_error_m=dataclasses.asdict(metrics.hand_errors(np.concatenate(errors), np.concatenate(reachable))),
            joint_error_rad=mean(row.joint_error_rad for row in rows),
            fell=sum(row.fell for row in rows),
            saturated_ticks=sum(row.saturated_ticks for row in rows),
            jitter=mean(row.jitter for row in rows),
            episodes=settings.episodes,
        )

    def describe(self, result: HandsResult) -> str:
        """Return hand errors, joint error, saturation and jitter, and the falls."""
        bounds = {name: _interval(estimate, name) for name, estimate in result.intervals.items()}
        intervals = {
            "hand error mean [cm]": bounds["hand_error_m"],
            "hand error mean, all targets [cm]": bounds["hand_error_all_m"],
        }
        rows = [
            *((*row, intervals.get(row[0])) for row in hand_rows([result.hand_error_m])),
            ("arm joints' error [rad]", result.joint_error_rad, bounds["joint_error_rad"]),
            ("control steps with an arm joint at its torque limit", result.saturated_ticks, None),
            ("jitter [rad^2/s^6]", result.jitter, None),
        ]
        falls = f"falls: {count_text(result.fell, result.episodes)}"
        table = format_table((result.gait, result.controller, INTERVAL), rows)
        return f"{table}\n\n{falls}\n{INTERVAL_NOTE}"


def _interval(estimate: Estimate, name: str) -> str | None:
    """Format the bounds of a figure's interval; of hand errors in centimetres."""
    if estimate.low is None or estimate.high is None:
        return None
    scale = 100.0 if name.startswith("hand_error") else 1.0
    return interval_text(Estimate(None, scale * estimate.low, scale * estimate.high, estimate.samples), 3)
