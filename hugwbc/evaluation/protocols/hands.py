"""How near the hands come to their targets in closed loop, standing or walking, with any controller."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from hugwbc.commands import Command
from hugwbc.controller import UpperBody
from hugwbc.errors import ConfigError
from hugwbc.evaluation import metrics
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.protocols.episodes import ControllerFactory, known, mean
from hugwbc.gait import Gait
from hugwbc.robot import load_robot
from hugwbc.runtime.loop import ArmSource, upper_body_source
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import RECORD_PERIOD, Trace
from hugwbc.scripts.hand_paths import Line
from hugwbc.scripts.script import DEFAULT_RAMP, HandMotion, Script, Segment
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import ArmIK, IKSolution

# Targets of the left hand in the pelvis frame [m]; the right hand's are drawn from the mirror image.
LOW, HIGH = np.array([0.15, 0.08, -0.05]), np.array([0.48, 0.50, 0.55])
LEG_TIME, DWELL = 1.2, 0.8  # [s] from target to target, and at each
REACHED = 0.005  # [m]
SATURATED = 0.99  # of a joint's torque limit
STANDING_START = 1.0  # [s] before a walk


@dataclasses.dataclass(frozen=True, kw_only=True)
class HandsConfig:
    """Settings of the protocol.

    Attributes:
        gait: of the episodes.
        v_x: forward velocity of gaits that move [m/s].
        episodes: how many, each with its own targets.
        seed: of the targets.
        duration: of an episode [s].
        settle: start of an episode that is left out: the arms are taken over [s].
        conditions: physics, ground and sensors.
    """

    gait: Gait
    v_x: float = 0.5
    episodes: int = 8
    seed: int = 0
    duration: float = 10.0
    settle: float = 2.0
    conditions: Conditions = dataclasses.field(default_factory=Conditions)

    def __post_init__(self) -> None:
        if not 0.0 <= self.settle < self.duration < math.inf:
            raise ConfigError(f"duration is {self.duration} s, settle {self.settle} s; give 0 <= settle < duration")
        if self.episodes < 1 or self.seed < 0:
            raise ConfigError(f"episodes is {self.episodes}, seed {self.seed}; give 1 or more, and 0 or more")
        if self.gait is not Gait.STANDING:
            Command(v_x=self.v_x, gait=self.gait).validate()
            if not self.duration > STANDING_START + DEFAULT_RAMP:
                raise ConfigError(
                    f"duration is {self.duration} s; give more than {STANDING_START + DEFAULT_RAMP:g} s, in which the "
                    f"{self.gait.label} gait gets going"
                )
        self.conditions.check_duration(self.duration)
        if self.conditions.intervention != "none":
            raise ConfigError("the hands protocol moves the arms itself; leave the intervention at none")


@dataclasses.dataclass(frozen=True)
class HandsEpisode:
    """One episode; all None where the robot fell before the settling time.

    Attributes:
        hand_error_m: mean distance of both hands to the targets that the inverse kinematics calls reachable [m].
        hand_error_all_m: to all targets [m].
        reachable_fraction: part of the samples in which it calls a target reachable.
        joint_error_rad: mean distance of the arm joints to the inverse kinematics' solution [rad].
        jitter: mean squared joint jerk of the commanded arms [rad^2/s^6].
        saturated_ticks: control steps with an arm joint at its torque limit.
        fell: whether the robot fell.
        survived_s: [s].
    """

    hand_error_m: float | None
    hand_error_all_m: float | None
    reachable_fraction: float | None
    joint_error_rad: float | None
    jitter: float | None
    saturated_ticks: int
    fell: bool
    survived_s: float


@dataclasses.dataclass(frozen=True)
class HandsResult:
    """Outcome of the protocol.

    Attributes:
        controller: name.
        gait: label.
        v_x: forward velocity [m/s].
        hand_error_m: `metrics.HandErrors` of all episodes [m]: to the targets that the inverse kinematics calls
            reachable, and to all, which all are (`reachable_targets`).
        joint_error_rad: mean distance of the arm joints to the inverse kinematics' solution [rad].
        fell: in how many episodes the robot fell.
        saturated_ticks: control steps with an arm joint at its torque limit.
        jitter: mean squared joint jerk of the commanded arms [rad^2/s^6].
        episodes, seed, duration, settle, conditions: as configured.
        rows: the episodes.
    """

    controller: str
    gait: str
    v_x: float
    hand_error_m: dict[str, float | None]
    joint_error_rad: float | None
    fell: int
    saturated_ticks: int
    jitter: float | None
    episodes: int
    seed: int
    duration: float
    settle: float
    conditions: Conditions
    rows: tuple[HandsEpisode, ...]


class _Recording:
    """Around an upper-body source: keeps what its inverse kinematics wanted, and what it commanded."""

    def __init__(self, source: ArmSource) -> None:
        self._source = source
        self.wanted: list[np.ndarray] = []
        self.commanded: list[np.ndarray] = []

    @property
    def solution(self) -> IKSolution | None:
        """The source's."""
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
        """The source's."""
        body, command = self._source.update(state, hands, command, dt, commanded)
        nothing = np.full(8, np.nan)
        self.wanted.append(nothing if self.solution is None else self.solution.q)
        self.commanded.append(body.q if body.indicator else nothing)
        return body, command

    def sampled(self, rows: list[np.ndarray], period: float) -> np.ndarray:
        """Rows at the times of a trace, shape (samples, 8)."""
        return np.array(rows[:: max(1, round(RECORD_PERIOD / period))])


def reachable_targets(count: int, rng: np.random.Generator) -> np.ndarray:
    """Pairs of hand targets in the pelvis frame that the arms reach on a nominal body [m], shape (count, 2, 3)."""
    robot = load_robot()
    state = RobotState(robot.nominal, np.zeros(19), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    ik, pairs = ArmIK(), []
    while len(pairs) < count:
        pair = rng.uniform(LOW, HIGH, (2, 3)) * np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 1.0]])
        ik.reset(robot.nominal[robot.arms])
        targets = HandTargets(pair[0], pair[1])
        solutions = [ik.solve(targets, state, 0.02) for _ in range(100)]
        if np.all(solutions[-1].residual < REACHED):
            pairs.append(pair)
    return np.array(pairs)


def hands_script(config: HandsConfig, rng: np.random.Generator) -> Script:
    """One episode: both hands go from one reachable target to the next, under the gait."""
    count = math.ceil(config.duration / (LEG_TIME + DWELL)) + 1
    pairs = reachable_targets(count, rng)
    left, right = (Line(tuple(tuple(p.tolist()) for p in pairs[:, hand]), LEG_TIME, DWELL) for hand in range(2))
    hands = HandMotion(left, right)
    if config.gait is Gait.STANDING:
        return Script("hands", (Segment("stand", config.duration, hands=hands, ramp=0.0),))
    walk = Segment("go", config.duration - STANDING_START, config.gait, {"v_x": config.v_x}, hands)
    return Script("hands", (Segment("stand", STANDING_START, hands=hands), walk))


def run_hands(
    factory: ControllerFactory, config: HandsConfig, on_episode: Callable[[HandsEpisode], None] | None = None
) -> HandsResult:
    """Run the protocol.

    Args:
        factory: makes the controller.
        config: settings.
        on_episode: called with every finished episode, in order.
    """
    controller = factory()
    rows, errors, reachable = [], [], []
    for index in range(config.episodes):
        seed = (config.seed, index)
        script = hands_script(config, np.random.default_rng(seed))
        source = _Recording(upper_body_source(controller))
        trace = rollout(
            controller,
            script,
            config.conditions.simulation(config.duration, seed),
            source,
            duration=config.duration,
            estimator=config.conditions.estimator(),
        )
        kept = trace.time >= config.settle
        errors.append(trace.hand_error[kept])
        reachable.append(trace.reachable[kept])
        rows.append(_judge(trace, source, controller.period, kept))
        if on_episode is not None:
            on_episode(rows[-1])
    return HandsResult(
        controller=controller.name,
        gait=config.gait.label,
        v_x=0.0 if config.gait is Gait.STANDING else config.v_x,
        hand_error_m=dataclasses.asdict(metrics.hand_errors(np.concatenate(errors), np.concatenate(reachable))),
        joint_error_rad=mean(row.joint_error_rad for row in rows),
        fell=sum(row.fell for row in rows),
        saturated_ticks=sum(row.saturated_ticks for row in rows),
        jitter=mean(row.jitter for row in rows),
        episodes=config.episodes,
        seed=config.seed,
        duration=config.duration,
        settle=config.settle,
        conditions=config.conditions,
        rows=tuple(rows),
    )


def _judge(trace: Trace, source: _Recording, period: float, kept: np.ndarray) -> HandsEpisode:
    robot = load_robot()
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
