"""The arena: robot, drives, sensors and ground of an evaluation.

There is one default (docs/arena.md). Results carry the arena in their identity, so those of different arenas never mix.
"""

import dataclasses
import functools
import json
from collections.abc import Mapping
from typing import TypedDict, TypeVar, Unpack

from hugwbc.errors import UnknownNameError
from hugwbc.files import digest
from hugwbc.robot import Robot, load_robot
from hugwbc.robot_tables import DEFAULT_ROBOT, robot_table
from hugwbc.settings import not_default
from hugwbc.sim.actuators import Actuators
from hugwbc.sim.engine import Engine
from hugwbc.sim.faults import Fault
from hugwbc.sim.physx import PhysxSimulation
from hugwbc.sim.robot_model import Variation
from hugwbc.sim.scenes.scene import Scene
from hugwbc.sim.sensors import ROBOT, SensorProfile, sensor_profile
from hugwbc.sim.simulation import Simulation
from hugwbc.sim.terrain import GROUNDS, Ground, HeightField

ENGINES: Mapping[str, type[Engine]] = {kind.engine: kind for kind in (Simulation, PhysxSimulation)}
DEFAULT_DRIVES = "real"
DRIVES = {DEFAULT_DRIVES: Actuators(), "ideal": Actuators.ideal()}

EngineT = TypeVar("EngineT", bound=Engine)


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
    """Robot, drives, sensors and ground of a simulation, by name; the default is an H1 as it is.

    Attributes:
        robot: Robot: h1 (59.3 kg), h1-2023, the maker's earlier description (51.65 kg), g1, or the path of a table.
        drives: real (torque-speed limit, friction and delay), or ideal.
        sensing: Sensors: robot (those of an H1, with noise, biases and latency, the state estimated from them), or
            exact (the true state).
        ground: firm (soles sink by millimetres), or soft (by centimetres).
    """

    robot: str = DEFAULT_ROBOT
    drives: str = DEFAULT_DRIVES
    sensing: str = ROBOT.name
    ground: str = GROUNDS[0]

    def __post_init__(self) -> None:
        if self.drives not in DRIVES:
            raise UnknownNameError("drives", self.drives, DRIVES)
        load_robot(self.robot)
        sensor_profile(self.sensing)
        Ground.named(self.ground)

    @functools.cached_property
    def version(self) -> str:
        """Digest of everything that these names stand for: it changes with any mass, gain, noise or firmness."""
        parts = [robot_table(self.robot)]
        parts += [dataclasses.asdict(part) for part in (self, self.actuators, self.profile, Ground.named(self.ground))]
        return digest(json.dumps(parts, sort_keys=True))[:8]

    @property
    def remark(self) -> str:
        """What differs from the default, such as "drives ideal, sensing exact"; empty for the default."""
        return not_default(self)

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
        """The robot as known to a controller or an estimator that is told the robot and drives of this arena."""
        return self.actuators.known_robot(load_robot(self.robot))

    @property
    def actuators(self) -> Actuators:
        """The drives."""
        return DRIVES[self.drives]

    def simulation(self, **episode: Unpack[EpisodeOptions]) -> Simulation:
        """Return a robot of this arena in MuJoCo; see `simulation_in`."""
        return self.simulation_in(Simulation, **episode)

    def simulation_in(self, engine: type[EngineT], **episode: Unpack[EpisodeOptions]) -> EngineT:
        """Return a robot of this arena in one of `ENGINES`; `EpisodeOptions` may differ between episodes."""
        return engine(
            sensing=self.profile,
            robot=load_robot(self.robot),
            actuators=self.actuators,
            ground=Ground.named(self.ground),
            **episode,
        )
