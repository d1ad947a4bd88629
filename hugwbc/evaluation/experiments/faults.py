"""What a robot does when sensors or motors fail while it walks: does it stay up, or reach the ground softly?

A fault that passes is survived if the robot has not fallen at the end. After one for good it must go down; what counts
is the speed of its pelvis whenever a link of its legs other than the feet touches the ground for the first time, and
that of its trunk when the trunk or an arm does: a robot that tips over turns about its pelvis, which may be slow then.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl

from hugwbc.controller import Controller
from hugwbc.errors import ConfigError
from hugwbc.evaluation.episode import CountedSettings, Row, ending, simulate, simulation_of
from hugwbc.evaluation.experiment import Experiment
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import bootstrap_mean, single, wilson_of
from hugwbc.evaluation.plans import Plan
from hugwbc.settings import Count, NotNegative, Positive, settings
from hugwbc.sim import Simulation
from hugwbc.state import RobotState

SOFT, V_X = 1.0, 0.5  # [m/s], at the ground, and of the walks
FOR_GOOD = ("IMU gone for good", "encoder stuck for good", "all readings frozen for good", "motor of a leg dead")
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
    "friction of 0.3": {"friction": 0.3},
    "friction of 1.5": {"friction": 1.5},
    "5 kg on the torso": {"payload": 5.0},
    "10 kg on the torso": {"payload": 10.0},
    "motor of an arm dead": {"faults": ("motor-dead=ARM@START",)},
    FOR_GOOD[0]: {"faults": ("imu-gone@START",)},
    FOR_GOOD[1]: {"faults": ("encoder-stuck=JOINT@START",)},
    FOR_GOOD[2]: {"faults": ("frozen@START",)},
    FOR_GOOD[3]: {"faults": ("motor-dead=JOINT@START",)},
}
_LOW = 0.765  # share of the pelvis's nominal height, below which something but the feet may touch the ground
_SPREAD = 1.0  # [s], in which faults start, so that they meet all phases of a stride
_JOINTS = ("hip_pitch", "knee", "hip_roll", "ankle_pitch", "hip_yaw")
_ARM_JOINTS = ("shoulder_pitch", "elbow", "shoulder_roll", "shoulder_yaw")


@settings(kw_only=True)
class FaultsSettings(CountedSettings):
    """Settings of faults."""

    episodes: Count = 20  # number of episodes of each fault; encoders and times differ
    # run only the faults with one of these words in their name, such as "for good" or IMU; by default all
    only: tuple[str, ...] = ()
    settle: NotNegative = 3.0  # time from which on the faults start [s]
    duration: Positive = 8.0  # length of an episode [s]
    varied = frozenset(field for change in FAULTS.values() for field in change)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.conditions.chosen.estimates or self.conditions.engine != Simulation.engine:
            raise ConfigError("faults are of the sensors of an H1 in MuJoCo; leave out --sensing and --engine")
        if self.duration < self.settle + _SPREAD + 3.0:
            raise ConfigError(f"duration is {self.duration} s; give 4 s more than settle, in which the robot goes down")
        for word in self.only:
            if not any(word in name for name in FAULTS):
                raise ConfigError(f"only: no fault has '{word}' in its name; faults are: {'; '.join(FAULTS)}")

    @property
    def faults(self) -> dict[str, Mapping[str, Any]]:
        """The chosen of `FAULTS`."""
        return {n: change for n, change in FAULTS.items() if not self.only or any(word in n for word in self.only)}


def plan(settings: FaultsSettings) -> list[Plan]:
    """Return the same walks for every fault."""
    plans, robot = [], settings.robot
    for name, change in settings.faults.items():
        for draw in range(settings.episodes):
            rng = np.random.default_rng((settings.seed, draw))
            start = round(settings.settle + float(rng.uniform(0.0, _SPREAD)), 3)
            said = {"START": f"{start}"}
            for word, joints in (("JOINT", _JOINTS), ("ARM", _ARM_JOINTS)):
                said[word] = robot.joint_names[robot.pair(joints[draw // 2 % len(joints)])[draw % 2]]
            faults = change.get("faults", ())
            for word, value in said.items():
                faults = tuple(text.replace(word, value) for text in faults)
            conditions = dataclasses.replace(settings.conditions, **{**change, "faults": faults})
            command = dataclasses.replace(settings.default_command(draw), v_x=V_X)
            plans.append(Plan(draw, command, {"fault": name, "start": start}, conditions=conditions))
    return plans


def episode(controller: Controller, settings: FaultsSettings, plan: Plan) -> Row:
    """Run one walk with a fault; it continues after a fall.

    - `faults`: as they were injected. `before`: whether the robot was down before the fault, or the physics diverged.
    - `fell`: whether it was, something but its feet touched the ground, or it knelt down since a fault was noticed;
      `lowered`: whether it knelt down.
    - `noticed_s`: time from the fault until it began to kneel [s]; None if it did not.
    - `refused`: number of control periods in which readings were replaced.
    - `touch_speed`: speed at which a link other than the feet touched the ground for the first time, the highest over
      the links [m/s]: that of the pelvis for the legs, of the trunk for the trunk and the arms, if that is higher; None
      if none touched.
    """
    assert plan.conditions is not None
    simulation = simulation_of(settings, plan)
    assert isinstance(simulation, Simulation)  # the settings refuse other engines
    watch = GroundSpeeds(simulation, float(plan.tags["start"]))
    trace = simulate(controller, settings, plan, simulation=simulation, on_step=watch, past_falls=True)
    start, lowered = float(plan.tags["start"]), trace.safety.lowered > 0
    before = watch.before or simulation.diverged
    return {
        **ending(trace),
        "faults": list(plan.conditions.faults),
        "before": before,
        "fell": before or watch.touch_speed is not None or lowered,
        "refused": sum(trace.safety.readings_refused.values()),
        "lowered": lowered,
        "noticed_s": settings.duration - trace.safety.lowered * controller.period - start if lowered else None,
        "touch_speed": watch.touch_speed,
    }


class GroundSpeeds:
    """Speeds of the pelvis and where links touch the ground; called after every physics step."""

    def __init__(self, simulation: Simulation, start: float) -> None:
        """Watch a robot from a time [s] on."""
        self._simulation, self._start = simulation, start
        robot = simulation.robot
        self._feet, self._low = set(robot.foot_links), _LOW * robot.nominal_height
        legs = [part for part, pair in robot.pairs.items() if pair[0] in robot.legs]
        self._legs = {robot.base, *(link for part in legs for link in robot.moved[part])}
        self._touched: set[str] = set()
        self.touch_speed: float | None = None  # see `episode`
        self.before = False  # whether another link than the feet touched the ground before that time

    def __call__(self, truth: RobotState, estimate: RobotState) -> None:
        """Take the true state after a physics step."""
        if truth.velocity is None or truth.position is None:
            return
        early, speed = truth.time < self._start, math.sqrt(truth.velocity.dot(truth.velocity))
        if truth.position[2] - self._simulation.ground_height(truth.position[:2]) >= self._low:
            return
        new = set(self._simulation.links_on_ground) - self._feet - self._touched
        self.before |= early and new != set()
        if new and not early:
            self._touched |= new
            if not new <= self._legs:
                speed = max(speed, float(np.linalg.norm(self._simulation.trunk_velocity)))
            self.touch_speed = max(self.touch_speed or 0.0, speed)


def figures(settings: FaultsSettings, rows: pl.DataFrame) -> list[Figure]:
    """Return, for every fault, how often it went well, and how fast the robot reached the ground.

    A walk went well without a fall; after a fault for good, if the robot reached the ground at less than 1 m/s and was
    not down before the fault.
    """
    found = []
    for name in settings.faults:
        part = rows.filter(pl.col("fault") == name)
        up = part.filter(~pl.col("before"))
        touched = up["touch_speed"].drop_nulls().to_list()
        good = sum(speed < SOFT for speed in touched) if name in FOR_GOOD else len(part) - int(part["fell"].sum())
        found.append(Figure(name, "went well", "% of episodes", wilson_of(good, len(part)), higher_is_better=True))
        if name in FOR_GOOD:
            noticed = part["noticed_s"].drop_nulls().to_list()
            found += [Figure(name, "noticed after, at most", "s", single(max(noticed)))] if noticed else []
        if touched:
            found.append(Figure(name, "speed at the ground", "m/s", bootstrap_mean(touched)))
            found.append(Figure(name, "speed at the ground, at most", "m/s", single(max(touched))))
    return found


EXPERIMENT = Experiment(
    "faults",
    "walks while sensors or motors fail: who stays up, and who reaches the ground softly",
    FaultsSettings,
    plan,
    episode,
    figures,
)
