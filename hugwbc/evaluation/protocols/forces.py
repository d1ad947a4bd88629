"""Forces at the hands and the sway of a walk: carrying, being pulled, pressing, pushes, and how still hands are.

- carry: a mass in each hand of which nobody is told; how far the hands sag, standing or walking.
- pull: a steady force on both hands together, from each of eight directions; whether the robot stays up.
- press: the left hand presses a wall with a wanted force; how far the contact force is off.
- push: a sudden push on the trunk from each of eight directions; the largest change of velocity that is survived.
- sway: how much the hands accelerate in a walk, held in the "steady" frame and with the arm joints held stiff.

With the sensors of a robot, the estimate of the forces on the hands is compared with the truth as well.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from hugwbc.commands import Command, default_command
from hugwbc.controller import Controller
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.protocols.episodes import ControllerFactory, CountedSettings, ProtocolResult, known, mean
from hugwbc.evaluation.protocols.protocol import Protocol, count_text
from hugwbc.evaluation.tables import format_table
from hugwbc.gait import Gait
from hugwbc.kinematics import Kinematics
from hugwbc.robot import SIDES, Robot, load_robot
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Trace
from hugwbc.sim import Engine, Force
from hugwbc.sim.hand_pull import HandPull
from hugwbc.sim.scenes.furniture import Wall
from hugwbc.sim.scenes.scene import Scene
from hugwbc.state import GRAVITY, RobotState
from hugwbc.targets import HandTargets
from hugwbc.upper_ik import UpperBodySource

PARTS = ("carry", "pull", "press", "push", "sway")
DIRECTIONS = tuple(range(0, 360, 45))  # [deg], counted from the robot's front to its left
TAKEN = 0.5  # [s], when the arms are taken over
STARTED = 1.0  # [s], when a walk starts
BEGIN = 3.0  # [s], when a force begins
RISE = 1.0  # [s], in which a steady force rises
PULLED, PRESSED, STEADY = 5.0, 4.0, 1.0  # [s]: full pull, press, and how long a pressing hand has to become steady
PUSH_TIME = 0.1  # [s]
PUSH_STEP, PUSH_MOST = 0.2, 1.6  # [m/s], between two pushes and the largest one
RECOVERY = 3.0  # [s] after a push in which the robot must not fall
SWAYED_FROM = 9.0  # [s], when the acceleration of the hands counts: they have learned the stride by then
SWAYED = 6.0  # [s], for which it counts
SAMPLE = 0.02  # [s], between the positions whose differences are the acceleration
HANDS = ((0.35, 0.2, 0.15), (0.35, -0.2, 0.15))  # targets in the pelvis frame [m]
WALL = 0.42  # [m], distance of the wall's surface ahead of the start
HEIGHT = 1.1  # [m], at which the hand presses


@dataclasses.dataclass(frozen=True)
class ForcesConfig(CountedSettings):
    """Settings of the forces protocol, in addition to `CountedSettings`.

    Attributes:
        gait: standing or walking; a hand presses standing, pushes come and hands sway while walking, whatever is given.
        episodes: number of episodes of a part; of pull and push for each direction.
        part: what to measure: carry, pull, press, push or sway.
        load: mass in each hand for carry [kg].
        force: steady force of pull on both hands together, or the wanted force of press [N].
        v_x: forward velocity of a walk [m/s].
    """

    gait: Gait = Gait.STANDING
    episodes: int = 2
    _: dataclasses.KW_ONLY
    part: str = "carry"
    load: float = 3.0
    force: float = 40.0
    v_x: float = 0.4
    settle: float = BEGIN

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.part not in PARTS:
            raise UnknownNameError("part of the forces protocol", self.part, PARTS)
        if self.gait not in (Gait.STANDING, Gait.WALKING):
            raise ConfigError(f"gait is {self.gait.label}; give standing or walking")
        if not 0.0 < self.force <= 500.0:
            raise ConfigError(f"force is {self.force} N; give a number above 0, up to 500 N")
        Command(v_x=self.v_x, gait=Gait.WALKING).validate()
        if self.conditions.intervention != "none":
            raise ConfigError("the forces protocol moves the arms itself; leave the intervention at none")
        if self.part == "press" and self.conditions.engine != "mujoco":
            raise ConfigError("a wall to press needs the engine mujoco; leave out the engine")
        self.loaded()

    def loaded(self) -> "ForcesConfig":
        """Return the settings with the load in the hands, where the part has one."""
        if self.part != "carry":
            return self
        conditions = dataclasses.replace(self.conditions, hand_payload=self.load)
        return self if self.conditions == conditions else dataclasses.replace(self, conditions=conditions)

    @property
    def walks(self) -> bool:
        """Whether the robot walks."""
        return self.part in ("push", "sway") or (self.gait is Gait.WALKING and self.part != "press")


@dataclasses.dataclass(frozen=True)
class ForcesEpisode:
    """One episode; what a part does not measure is None, as are figures of a robot that fell too early.

    Attributes:
        part: key of `PARTS`.
        direction: of the force [deg]; None for carry, press and sway.
        sag: how far both hands are below their targets on average [m].
        error: mean distance of the pressing hand's force along the wanted one to it, from `STEADY` on [N].
        change: change of velocity of the push [m/s].
        estimate_error: root mean square error of the estimated force on a hand, all axes together [N]; None without an
            estimator.
        acceleration: root mean square of the hands' acceleration in the world, held in the steady frame [m/s^2].
        stiff: the same with the arm joints held stiff.
        moved: distance of the pelvis from where it was when the force began, at the end [m].
        fell: whether the robot fell.
        survived_s: time until the fall, or the whole episode [s].
    """

    part: str
    direction: int | None
    sag: float | None
    error: float | None
    change: float | None
    estimate_error: float | None
    acceleration: float | None
    stiff: float | None
    moved: float | None
    fell: bool
    survived_s: float


@dataclasses.dataclass(frozen=True, kw_only=True)
class ForcesResult(ProtocolResult[ForcesEpisode]):
    """Result of the forces protocol, in addition to `ProtocolResult`.

    Attributes:
        part, load, force, v_x: as in the settings.
        episodes: number of episodes, of pushes those that were needed.
        falls: number of them in which the robot fell.
        sag: mean sag [m].
        error: mean error of the pressing force [N].
        estimate_error: root mean square error of the estimated force on a hand [N].
        acceleration: root mean square of the hands' acceleration, held in the steady frame [m/s^2].
        stiff: the same with the arm joints held stiff.
        ratio: the first divided by the second.
        held: share of episodes that the robot stayed up, by direction of a pull.
        change: largest survived change of velocity, by direction of a push: the median of its episodes [m/s].
        median_change: median of those of all directions and episodes [m/s].
    """

    part: str
    load: float
    force: float
    v_x: float
    episodes: int
    falls: int
    sag: float | None
    error: float | None
    estimate_error: float | None
    acceleration: float | None
    stiff: float | None
    ratio: float | None
    held: dict[str, float]
    change: dict[str, float]
    median_change: float | None


@dataclasses.dataclass(frozen=True)
class _Source:
    """Stands, and walks from `STARTED` on; the hands are taken at `TAKEN`, and press from `BEGIN` on.

    Attributes:
        settings: of the protocol.
        joints: positions at which the arm joints are held instead of the hands [rad], shape (8,).
    """

    settings: ForcesConfig
    joints: np.ndarray | None = None

    def command_at(self, t: float) -> Command:
        if not self.settings.walks or t < STARTED:
            return default_command(Gait.STANDING)
        speed = min(t - STARTED, 1.0) * self.settings.v_x
        return dataclasses.replace(default_command(Gait.WALKING), v_x=speed)

    def hands_at(self, t: float) -> HandTargets | None:
        if t < TAKEN:
            return None
        if self.joints is not None:
            return HandTargets(None, None, joints=self.joints)
        if self.settings.part == "sway":
            return HandTargets.of(*HANDS, "steady")
        if self.settings.part != "press":
            return HandTargets.of(*HANDS)
        pressing = t >= BEGIN
        return HandTargets.of(
            (WALL - (0.02 if pressing else 0.05), HANDS[0][1], HEIGHT),
            None,
            "world",
            left_force=(self.settings.force, 0.0, 0.0) if pressing else None,
        )


class _Watch:
    """Collects, after each physics step from `BEGIN` on, what the record of a rollout does not have."""

    def __init__(self, settings: ForcesConfig, pull: HandPull | None) -> None:
        self._settings, self._pull = settings, pull
        self.squares: list[float] = []
        self.misses: list[float] = []
        self.begun: np.ndarray | None = None
        self.end = np.zeros(3)

    def __call__(self, truth: RobotState, estimate: RobotState) -> None:
        if self._pull is not None:
            self._pull.update(truth)
        if truth.time < BEGIN or truth.position is None:
            return
        if self.begun is None:
            self.begun = truth.position.copy()
        self.end = truth.position
        settings = self._settings
        if (
            settings.part == "press"
            and truth.time > BEGIN + settings.force / 100.0 + STEADY
            and truth.hand_force is not None
        ):
            self.misses.append(abs(-float(truth.hand_force[0, 0]) - settings.force))
        force = self._force(truth)
        if force is not None and estimate.hand_force is not None and truth.time > BEGIN + RISE:
            self.squares.append(float(np.mean(np.sum((estimate.hand_force - force) ** 2, axis=1))))

    def _force(self, truth: RobotState) -> np.ndarray | None:
        """Return the true force on each hand."""
        if self._pull is not None:
            return self._pull.force
        if self._settings.part == "carry":
            return np.tile((0.0, 0.0, -GRAVITY * self._settings.load), (2, 1))
        return truth.hand_force if self._settings.part == "press" else None


def _simulation(settings: ForcesConfig, seed: tuple[int, int], duration: float) -> Engine:
    conditions = settings.conditions
    if settings.part != "press":
        return conditions.simulation(duration, seed)
    wall = Wall(name="wall", position=(WALL + 0.05, 0.0), size=(0.1, 3.0, 2.5))
    return conditions.chosen.simulation(
        timestep=conditions.timestep,
        variation=conditions.variation(),
        latency=conditions.latency,
        seed=int(np.random.SeedSequence(seed).generate_state(1)[0]),
        scene=Scene((wall,)),
    )


class _HandWatch:
    """Collects where the hands truly are in the world, every `SAMPLE` from `SWAYED_FROM` on."""

    def __init__(self, robot: Robot) -> None:
        self._kinematics = Kinematics(robot)
        self.points: list[list[np.ndarray]] = []

    def __call__(self, truth: RobotState, estimate: RobotState) -> None:
        if truth.time < SWAYED_FROM + len(self.points) * SAMPLE - 1e-6:
            return
        self._kinematics.update(truth)
        self.points.append([self._kinematics.position(f"{side}_hand") for side in SIDES])

    def acceleration(self) -> float | None:
        """Return the root mean square of both hands' acceleration [m/s^2]; None if nothing was seen."""
        if len(self.points) < 3:
            return None
        accelerations = np.diff(np.array(self.points), n=2, axis=0) / SAMPLE**2
        return float(np.sqrt(np.mean(np.sum(accelerations**2, axis=2))))


def _sway(controller: Controller, settings: ForcesConfig, index: int) -> ForcesEpisode:
    """Walk with the hands in the steady frame, then in the same conditions with stiff arms."""
    duration, figures, ends = SWAYED_FROM + SWAYED, [], []
    for stiff in (False, True):
        simulation = _simulation(settings, (settings.seed, index), duration)
        robot = simulation.robot
        watch = _HandWatch(robot)
        trace = rollout(
            controller,
            _Source(settings, robot.nominal[robot.arms] if stiff else None),
            simulation,
            UpperBodySource(robot=robot),
            duration=duration,
            estimator=settings.conditions.estimator(),
            on_step=watch,
        )
        figures.append(None if trace.fell else watch.acceleration())
        ends.append(trace)
    return ForcesEpisode(
        part=settings.part,
        direction=None,
        sag=None,
        error=None,
        change=None,
        estimate_error=None,
        acceleration=figures[0],
        stiff=figures[1],
        moved=None,
        fell=any(trace.fell for trace in ends),
        survived_s=min(trace.survived_s for trace in ends),
    )


def _run(
    controller: Controller, settings: ForcesConfig, index: int, direction: int | None, change: float | None = None
) -> ForcesEpisode:
    """Run one episode."""
    if settings.part == "sway":
        return _sway(controller, settings, index)
    angle = math.radians(direction or 0)
    heading = np.array([math.cos(angle), math.sin(angle), 0.0])
    duration = {"pull": BEGIN + RISE + PULLED, "press": BEGIN + settings.force / 100.0 + PRESSED}.get(
        settings.part, BEGIN + RECOVERY
    )
    simulation, pushes, pull = _simulation(settings, (settings.seed, index), duration), (), None
    if settings.part == "pull":
        pull = HandPull(simulation, settings.force * heading, BEGIN, RISE)
    if change is not None:
        vector = tuple((simulation.robot.mass * change / PUSH_TIME * heading).tolist())
        # Pushes of one direction meet the gait at different times.
        pushes = (Force(vector, BEGIN + 0.13 * (index % 8), PUSH_TIME, frame="heading"),)
    watch = _Watch(settings, pull)
    trace = rollout(
        controller,
        _Source(settings),
        simulation,
        UpperBodySource(robot=simulation.robot),
        duration=duration,
        estimator=settings.conditions.estimator(),
        forces=pushes,
        on_step=watch,
    )
    return ForcesEpisode(
        part=settings.part,
        direction=direction,
        sag=_sag(trace) if settings.part == "carry" else None,
        error=_mean(watch.misses) if settings.part == "press" and not trace.fell else None,
        change=change,
        estimate_error=None if not watch.squares else math.sqrt(float(np.mean(watch.squares))),
        acceleration=None,
        stiff=None,
        moved=None if watch.begun is None else float(np.linalg.norm((watch.end - watch.begun)[:2])),
        fell=trace.fell,
        survived_s=trace.survived_s,
    )


def _mean(values: list[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _root_mean_square(values: list[float | None]) -> float | None:
    known_values = [value for value in values if value is not None]
    return math.sqrt(float(np.mean(np.square(known_values)))) if known_values else None


def _sag(trace: Trace) -> float | None:
    """Return how far the hands are below their targets from `BEGIN` on [m], by the recorded bodies."""
    kept = trace.time >= BEGIN
    if trace.fell or not kept.any():
        return None
    kinematics, drops = Kinematics(load_robot(trace.robot)), []
    for qpos, targets in zip(trace.qpos[kept], trace.hand_target_world[kept], strict=True):
        state = RobotState(
            q=qpos[7:], dq=np.zeros(19), orientation=qpos[3:7], angular_velocity=np.zeros(3), position=qpos[:3]
        )
        kinematics.update(state)
        drops.append([targets[hand, 2] - kinematics.position(f"{side}_hand")[2] for hand, side in enumerate(SIDES)])
    return known(float(np.nanmean(drops)))


class ForcesProtocol(Protocol[ForcesConfig, ForcesEpisode, ForcesResult]):
    """Forces at the hands and on the trunk; its episodes run in one process, and are not stored."""

    name = "forces"
    summary = "carrying, being pulled at the hands, pressing a wall, sudden pushes, still hands in a walk"
    settings = ForcesConfig
    fixed = frozenset({"intervention", "motions", "hand_payload"})
    stores_episodes = False

    def total(self, settings: ForcesConfig) -> int:
        """Return the number of episodes; of pushes the most that a search may take."""
        directions = len(DIRECTIONS) if settings.part in ("pull", "push") else 1
        steps = round(PUSH_MOST / PUSH_STEP) if settings.part == "push" else 1
        return settings.episodes * directions * steps

    def run(
        self,
        factory: ControllerFactory,
        settings: ForcesConfig,
        on_episode: Callable[[ForcesEpisode], None] | None = None,
    ) -> ForcesResult:
        """Run the episodes one after the other; arguments as in `Protocol`."""
        controller, loaded = factory(), settings.loaded()
        rows: list[ForcesEpisode] = []

        def run(index: int, direction: int | None, change: float | None = None) -> ForcesEpisode:
            rows.append(_run(controller, loaded, index, direction, change))
            if on_episode is not None:
                on_episode(rows[-1])
            return rows[-1]

        directions: Sequence[int | None] = DIRECTIONS if settings.part in ("pull", "push") else (None,)
        survived: dict[str, list[float]] = {}
        for direction in directions:
            for index in range(settings.episodes):
                if settings.part != "push":
                    run(index, direction)
                    continue
                largest = 0.0
                for step in range(1, round(PUSH_MOST / PUSH_STEP) + 1):
                    if run(index, direction, step * PUSH_STEP).fell:
                        break
                    largest = step * PUSH_STEP
                survived.setdefault(str(direction), []).append(largest)
        errors = [row.estimate_error for row in rows if row.estimate_error is not None]
        pulls = {str(d): [not row.fell for row in rows if row.direction == d] for d in directions if d is not None}
        steady, stiff = (_root_mean_square([getattr(row, name) for row in rows]) for name in ("acceleration", "stiff"))
        return ForcesResult.of(
            lambda: controller,
            settings,
            rows,
            part=settings.part,
            load=settings.load,
            force=settings.force,
            v_x=settings.v_x if settings.walks else 0.0,
            episodes=len(rows),
            falls=sum(row.fell for row in rows),
            sag=mean(row.sag for row in rows),
            error=mean(row.error for row in rows),
            estimate_error=math.sqrt(float(np.mean(np.square(errors)))) if errors else None,
            acceleration=steady,
            stiff=stiff,
            ratio=None if steady is None or stiff is None else steady / stiff,
            held={d: float(np.mean(up)) for d, up in pulls.items()} if settings.part == "pull" else {},
            change={d: float(np.median(changes)) for d, changes in survived.items()},
            median_change=float(np.median([*survived.values()])) if survived else None,
        )

    def describe(self, result: ForcesResult) -> str:
        """Return what the part measures, by direction where it has any, and the falls."""
        rows: list[tuple[object, ...]] = []
        if result.part == "carry":
            rows = [(f"sag with {result.load:g} kg in each hand [cm]", _scaled(result.sag, 100.0))]
        elif result.part == "press":
            rows = [(f"error of the wanted {result.force:g} N [N]", result.error)]
        elif result.part == "sway":
            rows = [
                (f"acceleration of the hands at {result.v_x:g} m/s, steady frame, RMS [m/s^2]", result.acceleration),
                ("with the arm joints held stiff [m/s^2]", result.stiff),
                ("ratio", result.ratio),
            ]
        elif result.part == "pull":
            rows = [(f"stays up with {result.force:g} N at {d} deg [%]", 100.0 * up) for d, up in result.held.items()]
        else:
            rows = [(f"survived push at {d} deg [m/s]", change) for d, change in result.change.items()]
            rows.append(("median of all [m/s]", result.median_change))
        if result.part not in ("push", "sway"):
            rows.append(("error of the estimated force on a hand, RMS [N]", result.estimate_error))
        table = format_table((result.part, result.controller), rows)
        return f"{table}\n\nfalls: {count_text(result.falls, result.episodes)}"


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value
