"""The arena: robot, drives, sensors and ground of an evaluation.

Results carry the arena in their identity, so results of different arenas never mix. There are two (docs/arena.md):

1. The maker's earlier description of the H1 (51.65 kg), ideal drives, soft ground, the true state.
2. The corrected description (59.34 kg), drives with a torque-speed limit, friction and delay, firm ground, and only the
   sensors that an H1 has.
"""

import dataclasses
import functools
import hashlib
import json
from collections.abc import Mapping
from typing import TypedDict, TypeVar, Unpack

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.robot import DEFAULT_ROBOT, Robot, load_robot, robot_table
from hugwbc.sim.actuators import Actuators
from hugwbc.sim.engine import Engine
from hugwbc.sim.faults import Fault
from hugwbc.sim.ground import Ground
from hugwbc.sim.physx import PhysxSimulation
from hugwbc.sim.scenes.scene import Scene
from hugwbc.sim.sensors import SensorProfile, sensor_profile
from hugwbc.sim.simulation import Simulation
from hugwbc.sim.terrain import HeightField
from hugwbc.sim.variation import Variation

ENGINES: Mapping[str, type[Engine]] = {kind.engine: kind for kind in (Simulation, PhysxSimulation)}
DEFAULT_DRIVES = "real"
DRIVES = {DEFAULT_DRIVES: Actuators(), "ideal": Actuators.ideal()}

EngineT = TypeVar("EngineT", bound=Engine)


def known_robot(robot: str = DEFAULT_ROBOT, drives: str = DEFAULT_DRIVES) -> Robot:
    """Return the robot with its drives, by their names, as known to a controller or estimator.

    Raises:
        UnknownNameError: if there is no such robot, or are no such drives.
    """
    if drives not in DRIVES:
        raise UnknownNameError("drives", drives, DRIVES)
    return DRIVES[drives].known_robot(load_robot(robot))


class EpisodeOptions(TypedDict, total=False):
    """What may differ between the episodes in one arena; see the constructor of `Engine`."""

    timestep: float
    terrain: HeightField | None
    latency: float | None
    seed: int
    variation: Variation | None
    scene: Scene | None
    faults: tuple[Fault, ...]


@dataclasses.dataclass(frozen=True)
class Arena:
    """Robot, drives, sensors and ground of a simulation, by name.

    Attributes:
        robot: robot of models/h1/h1.yaml: h1 (59.3 kg), or h1-2023, the maker's earlier description (51.65 kg).
        drives: real (torque-speed limit, friction and delay), or ideal.
        sensing: Sensors: robot (those of an H1, with noise, biases and latency, the state estimated from them), or
            exact (the true state).
        ground: firm (soles sink by millimetres), or soft (by centimetres).

    Raises:
        UnknownNameError: if there is no robot, are no drives, sensors or ground of that name.
    """

    robot: str
    drives: str
    sensing: str
    ground: str

    def __post_init__(self) -> None:
        known_robot(self.robot, self.drives)
        sensor_profile(self.sensing)
        Ground.named(self.ground)

    @functools.cached_property
    def version(self) -> str:
        """Digest of everything that these names stand for: it changes with any mass, gain, noise or firmness."""
        parts = [robot_table(self.robot)]
        parts += [dataclasses.asdict(part) for part in (self, self.actuators, self.profile, Ground.named(self.ground))]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:8]

    @property
    def profile(self) -> SensorProfile:
        """The sensors."""
        return sensor_profile(self.sensing)

    @property
    def estimates(self) -> bool:
        """Whether a controller needs the state estimated: the sensors do not tell the pelvis's position."""
        return not self.profile.position

    @property
    def known_robot(self) -> Robot:
        """The robot as known to a controller or estimator that is told the arena's."""
        return known_robot(self.robot, self.drives)

    @property
    def actuators(self) -> Actuators:
        """The drives."""
        return DRIVES[self.drives]

    def simulation(self, **episode: Unpack[EpisodeOptions]) -> Simulation:
        """Return a robot of this arena in MuJoCo; see `simulation_in` for the arguments."""
        return self.simulation_in(Simulation, **episode)

    def simulation_in(self, engine: type[EngineT], **episode: Unpack[EpisodeOptions]) -> EngineT:
        """Return a robot of this arena in an engine.

        Args:
            engine: the engine, one of `ENGINES`.
            episode: what differs between episodes, see `EpisodeOptions` and the constructor of `Engine`.

        Raises:
            ConfigError: if the engine is not installed, has no such ground or no objects, or the scene is made for
                another robot or ground.
            SceneError: if objects overlap, as drawn, or the robot stands in one.
        """
        return engine(
            sensing=self.profile,
            robot=load_robot(self.robot),
            actuators=self.actuators,
            ground=Ground.named(self.ground),
            **episode,
        )


ARENAS = {1: Arena("h1-2023", "ideal", "exact", "soft"), 2: Arena("h1", "real", "robot", "firm")}
DEFAULT_ARENA = 2


@dataclasses.dataclass(frozen=True)
class ArenaChoice:
    """An arena by its number, and what differs from it.

    Attributes:
        arena: Arena (docs/arena.md): 1 (light robot, ideal drives, soft ground, true state), or 2 (an H1 as it is
            weighed, with real drives, firm ground and only the sensors that it has).
        robot: Robot: h1 (59.3 kg), or h1-2023, the maker's earlier description (51.65 kg); by default the arena's.
        drives: Drives of the joints: real (torque-speed limit, friction and delay), or ideal; by default
            the arena's.
        sensing: Sensors: robot (those of an H1, with noise, biases and latency, the state estimated from them), or
            exact (the true state); by default the arena's.
        ground: Ground: firm, or soft; by default the arena's.

    Raises:
        ConfigError: if there is no arena of that number.
        UnknownNameError: if one of the names is unknown.
    """

    arena: int = DEFAULT_ARENA
    robot: str | None = None
    drives: str | None = None
    sensing: str | None = None
    ground: str | None = None

    def __post_init__(self) -> None:
        if self.arena not in ARENAS:
            raise ConfigError(f"there is no arena {self.arena}; give one of {', '.join(map(str, ARENAS))}")
        _ = self.chosen

    @property
    def chosen(self) -> Arena:
        """The arena with the differences."""
        names = [field.name for field in dataclasses.fields(Arena)]
        given = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return dataclasses.replace(ARENAS[self.arena], **given)
