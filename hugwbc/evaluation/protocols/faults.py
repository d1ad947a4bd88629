"""What a robot does when sensors or motors fail while it walks: does it stay up, or reach the ground softly?

A fault that passes is survived if the robot has not fallen at the end. After one for good it must go down; what counts
is the speed of its pelvis whenever a link of its legs other than the feet touches the ground for the first time, and
that of its trunk when the trunk or an arm does: a robot that tips over turns about its pelvis, which may be slow then.
"""

import collections
import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hugwbc.commands import default_command
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import EpisodePlan
from hugwbc.evaluation.protocols.episodes import CountedSettings, ProtocolResult, Run
from hugwbc.evaluation.protocols.protocol import PlannedProtocol, count_text
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait
from hugwbc.robot import SIDES
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Trace
from hugwbc.scripts.command_source import Constant
from hugwbc.sim import Simulation
from hugwbc.state import RobotState

SOFT = 1.0  # [m/s]
FOR_GOOD = ("IMU gone for good", "encoder stuck for good", "all readings frozen for good")
# A time START in a fault is that of the episode; conditions without one hold from its beginning.
FAULTS: Mapping[str, Mapping[str, Any]] = {
    "none": {},
    "IMU gone for 200 ms": {"faults": ("imu-gone@START:0.2",)},
    "encoder stuck for 200 ms": {"faults": ("encoder-stuck=JOINT@START:0.2",)},
    "all readings frozen for 100 ms": {"faults": ("frozen@START:0.1",)},
    "one velocity of 500 rad/s": {"faults": ("wild-speed=JOINT@START:0",)},
    "time stamps out of order for 500 ms": {"faults": ("disordered@START:0.5",)},
    "one reading in ten lost": {"faults": ("dropped=0.1@START",)},
    "three readings in ten lost": {"faults": ("dropped=0.3@START",)},
    "IMU tilted by 2 degrees, gyro biased by 0.1 rad/s": {"faults": ("imu-bias@START",)},
    "three times the encoders' noise": {"faults": ("encoder-noise@START",)},
    "latency of 20 ms": {"latency": 0.02},
    "latency of 40 ms": {"latency": 0.04},
    "motors with 0.8 of their torque": {"strength": 0.8},
    "stiffness and damping less by 20 %": {"gain": 0.8},
    "stiffness and damping more by 20 %": {"gain": 1.2},
    "friction of 0.2": {"friction": 0.2},
    "friction of 1.5": {"friction": 1.5},
    "5 kg on the torso": {"payload": 5.0},
    "10 kg on the torso": {"payload": 10.0},
    "motor of an arm dead": {"faults": ("motor-dead=ARM@START",)},
    "motor of a leg dead": {"faults": ("motor-dead=JOINT@START",)},
    FOR_GOOD[0]: {"faults": ("imu-gone@START",)},
    FOR_GOOD[1]: {"faults": ("encoder-stuck=JOINT@START",)},
    FOR_GOOD[2]: {"faults": ("frozen@START",)},
}
_LOW = 0.75  # [m], height of the pelvis below which something but the feet may touch the ground
_LOWER_BODY = ("pelvis", "hip", "knee", "ankle")  # parts of the names of links
_SPREAD = 1.0  # [s], in which faults start, so that they meet all phases of a stride
_JOINTS = ("hip_pitch", "knee", "hip_roll", "ankle", "hip_yaw")
_ARM_JOINTS = ("shoulder_pitch", "elbow", "shoulder_roll", "shoulder_yaw")


@dataclasses.dataclass(frozen=True)
class FaultsConfig(CountedSettings):
    """Settings of the protocol of faults, in addition to `CountedSettings`.

    Attributes:
        episodes: number of episodes of each fault; encoders and moments differ.
        speed: forward velocity of the walks [m/s].
        only: words; faults whose name contains one of them, such as "for good" or IMU. Without any, all.
        settle: time from which on the faults start [s].
        duration: length of an episode [s].
    """

    episodes: int = 20
    _: dataclasses.KW_ONLY
    speed: float = 0.5
    only: tuple[str, ...] = ()
    settle: float = 3.0
    duration: float = 8.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.conditions.chosen.estimates or self.conditions.engine != Simulation.engine:
            raise ConfigError("faults are of the sensors of an H1 in MuJoCo; leave out --sensing and --engine")
        if self.duration < self.settle + _SPREAD + 3.0:
            raise ConfigError(f"duration is {self.duration} s; give 4 s more than settle, in which the robot goes down")
        dataclasses.replace(default_command(self.gait), v_x=self.speed).validate()
        for word in self.only:
            if not any(word in name for name in FAULTS):
                raise ConfigError(f"only: no fault has '{word}' in its name; faults are: {'; '.join(FAULTS)}")

    @property
    def faults(self) -> dict[str, Mapping[str, Any]]:
        """The chosen of `FAULTS`."""
        return {n: change for n, change in FAULTS.items() if not self.only or any(word in n for word in self.only)}


@dataclasses.dataclass(frozen=True)
class FaultEpisode:
    """One walk with a fault.

    Attributes:
        fault: its name, a key of `FAULTS`.
        faults: as they were injected.
        fell: whether the robot fell, or knelt down since its state was lost.
        refused: number of control periods in which readings were replaced.
        lowered: whether the robot knelt down.
        touch_speed: speed at which a link other than the feet touched the ground for the first time, the highest over
            the links [m/s]: that of the pelvis for the legs, of the trunk for the trunk and the arms, if that is
            higher; None if none touched.
        first_touch_speed: speed of the pelvis at the first of these touches alone [m/s].
        highest_speed: highest speed of the pelvis from the fault to the end [m/s].
    """

    fault: str
    faults: tuple[str, ...]
    fell: bool
    refused: int
    lowered: bool
    touch_speed: float | None
    first_touch_speed: float | None
    highest_speed: float


@dataclasses.dataclass(frozen=True)
class FaultFigures:
    """All episodes of a fault.

    Attributes:
        held: episodes that went well: no fall, or after a fault for good, less than 1 m/s where the robot reached the
            ground.
        episodes: number of episodes.
        soft_pelvis: episodes in which the pelvis alone was slower than 1 m/s at the first touch.
        touch_speed: mean of the speeds at the ground [m/s]; None if nothing touched it.
        highest_touch_speed: the highest of them [m/s].
        highest_speed: mean of the highest speeds [m/s].
    """

    held: int
    episodes: int
    soft_pelvis: int
    touch_speed: float | None
    highest_touch_speed: float | None
    highest_speed: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class FaultsResult(ProtocolResult[FaultEpisode]):
    """Result of the protocol, in addition to `ProtocolResult`.

    Attributes:
        faults: figures by the name of the fault.
    """

    faults: dict[str, FaultFigures]


class GroundWatch:
    """A watch over the pelvis's speed, called after every physics step (`rollout`'s `on_step`).

    Attributes:
        touch_speed: see `FaultEpisode`.
        first_touch_speed: see `FaultEpisode`.
        highest_speed: see `FaultEpisode`.
    """

    def __init__(self, simulation: Simulation, start: float) -> None:
        """Watch a robot from a time [s] on."""
        self._simulation, self._start = simulation, start
        self._feet = {f"{side}_ankle_link" for side in SIDES}
        self._legs = {link for link in simulation.link_names if any(part in link for part in _LOWER_BODY)}
        self._touched: set[str] = set()
        self.touch_speed: float | None = None
        self.first_touch_speed: float | None = None
        self.highest_speed = 0.0

    def __call__(self, truth: RobotState, estimate: RobotState) -> None:
        """Take the true state after a physics step."""
        if truth.time < self._start or truth.velocity is None:
            return
        speed = math.sqrt(truth.velocity.dot(truth.velocity))
        self.highest_speed = max(self.highest_speed, speed)
        if truth.position is None or truth.position[2] >= _LOW:
            return
        new = set(self._simulation.links_on_ground) - self._feet - self._touched
        if new:
            self._touched |= new
            if self.first_touch_speed is None:
                self.first_touch_speed = speed
            if not new <= self._legs:
                speed = max(speed, float(np.linalg.norm(self._simulation.trunk_velocity)))
            self.touch_speed = max(self.touch_speed or 0.0, speed)


@dataclasses.dataclass(frozen=True)
class FaultStage:
    """One walk with a fault, which goes on after a fall.

    Attributes:
        speed: forward velocity [m/s].
        gait: of the walk.
        start: time of the fault [s].
        duration: of the episode [s].
    """

    speed: float
    gait: Gait
    start: float
    duration: float

    def play(self, controller: Controller, conditions: Conditions, seed: tuple[int, int]) -> tuple[Trace, GroundWatch]:
        """Run the episode."""
        simulation = conditions.simulation(self.duration, seed)
        assert isinstance(simulation, Simulation)  # the settings refuse other engines
        watch = GroundWatch(simulation, self.start)
        command = dataclasses.replace(default_command(self.gait), v_x=self.speed)
        trace = rollout(
            controller,
            Constant(command),
            simulation,
            duration=self.duration,
            estimator=conditions.estimator(),
            on_step=watch,
            past_falls=True,
        )
        return trace, watch


@dataclasses.dataclass(frozen=True)
class FaultJudge:
    """Judge that reads the fault from the plan's label."""

    def __call__(self, index: int, run: Run) -> FaultEpisode:
        """Return the row of one episode."""
        watch, safety = run.outcome, run.trace.safety
        assert run.plan.conditions is not None
        return FaultEpisode(
            fault=run.plan.label,
            faults=run.plan.conditions.faults,
            fell=watch.touch_speed is not None or safety.lowered > 0,
            refused=sum(safety.readings_refused.values()),
            lowered=safety.lowered > 0,
            touch_speed=watch.touch_speed,
            first_touch_speed=watch.first_touch_speed,
            highest_speed=watch.highest_speed,
        )


class FaultsProtocol(PlannedProtocol[FaultsConfig, FaultEpisode, FaultsResult]):
    """Walks with faults of sensors and motors."""

    name = "faults"
    summary = "walks while sensors or motors fail: who stays up, and who reaches the ground softly"
    settings = FaultsConfig
    result = FaultsResult
    fixed = frozenset({"faults", "latency"})  # what differs

    def plans(self, settings: FaultsConfig) -> list[EpisodePlan]:
        """Return the same walks for every fault."""
        plans = []
        for name, change in settings.faults.items():
            for draw in range(settings.episodes):
                rng = np.random.default_rng((settings.seed, draw))
                start = round(settings.settle + float(rng.uniform(0.0, _SPREAD)), 3)
                said = {"START": f"{start}"}
                for word, joints in (("JOINT", _JOINTS), ("ARM", _ARM_JOINTS)):
                    said[word] = f"{SIDES[draw % 2]}_{joints[draw // 2 % len(joints)]}_joint"
                faults = change.get("faults", ())
                for word, value in said.items():
                    faults = tuple(text.replace(word, value) for text in faults)
                conditions = dataclasses.replace(settings.conditions, **{**change, "faults": faults})
                stage = FaultStage(settings.speed, settings.gait, start, settings.duration)
                command = dataclasses.replace(default_command(settings.gait), v_x=settings.speed)
                plans.append(EpisodePlan(command, conditions=conditions, draw=draw, label=name, stage=stage))
        return plans

    def judge(self, settings: FaultsConfig) -> FaultJudge:
        """Return the judge."""
        return FaultJudge()

    def summarise(self, settings: FaultsConfig, rows: Sequence[FaultEpisode]) -> dict[str, Any]:
        """Return the figures of each fault."""
        by_name: dict[str, list[FaultEpisode]] = collections.defaultdict(list)
        for row in rows:
            by_name[row.fault].append(row)
        return {"faults": {name: fault_figures(found) for name, found in by_name.items()}}

    def describe(self, result: FaultsResult) -> str:
        """Return a row for each fault."""
        table = [
            (
                name,
                count_text(found.held, found.episodes),
                found.soft_pelvis if name in FOR_GOOD else None,
                found.touch_speed,
                found.highest_touch_speed,
                found.highest_speed,
            )
            for name, found in result.faults.items()
        ]
        columns = (
            "went well",
            "pelvis soft at first",
            "at the ground [m/s]",
            "at most [m/s]",
            "highest after the fault [m/s]",
        )
        return format_table((f"{result.gait}, {result.controller}", *columns), table)


def fault_figures(rows: Sequence[FaultEpisode]) -> FaultFigures:
    """Return the figures of the episodes of one fault."""
    touched = [row.touch_speed for row in rows if row.touch_speed is not None]
    if rows[0].fault in FOR_GOOD:
        held = sum(row.touch_speed is not None and row.touch_speed < SOFT for row in rows)
    else:
        held = sum(not row.fell for row in rows)
    return FaultFigures(
        held=held,
        episodes=len(rows),
        soft_pelvis=sum(row.first_touch_speed is not None and row.first_touch_speed < SOFT for row in rows),
        touch_speed=float(np.mean(touched)) if touched else None,
        highest_touch_speed=max(touched, default=None),
        highest_speed=float(np.mean([row.highest_speed for row in rows])),
    )
