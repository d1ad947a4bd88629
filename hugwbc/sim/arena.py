"""The arena: which robot, with which drives and sensors, on which ground, every comparison uses by default.

Results carry the arena in their identity, so results of different arenas never mix. A change of what a default robot
meets raises `ARENA_VERSION`:

1. The maker's earlier description of the H1 (51.65 kg), ideal drives, soft ground, the true state.
2. The corrected description (59.34 kg), drives with a torque-speed limit, friction and delay, firm ground, and only the
   sensors that an H1 has (docs/arena.md).
"""

import dataclasses

from hugwbc.errors import UnknownNameError
from hugwbc.robot import load_robot
from hugwbc.sim.actuators import Actuators
from hugwbc.sim.scene import SIMULATION_TIMESTEP
from hugwbc.sim.sensors import SensorProfile, sensor_profile
from hugwbc.sim.simulation import Simulation
from hugwbc.sim.terrain import HeightField
from hugwbc.sim.variation import Variation

ARENA_VERSION = 2
DRIVES = {"real": Actuators(), "ideal": Actuators.ideal()}


@dataclasses.dataclass(frozen=True)
class Arena:
    """Robot, drives and sensors of a simulation, by name.

    Attributes:
        robot: robot of models/h1/h1.yaml: h1 (59.3 kg), or h1-2023, the maker's earlier description (51.65 kg).
        drives: real (torque-speed limit, friction and delay), or ideal.
        sensing: sensors: robot (those of an H1, with noise, biases and latency, the state estimated from them), or
            exact (the true state).

    Raises:
        UnknownNameError: if there is no robot, are no drives or no sensors of that name.
    """

    robot: str = "h1"
    drives: str = "real"
    sensing: str = "robot"

    def __post_init__(self) -> None:
        load_robot(self.robot)
        if self.drives not in DRIVES:
            raise UnknownNameError("drives", self.drives, DRIVES)
        sensor_profile(self.sensing)

    @property
    def profile(self) -> SensorProfile:
        """The sensors."""
        return sensor_profile(self.sensing)

    @property
    def estimates(self) -> bool:
        """Whether a controller needs the state estimated: the sensors do not tell the pelvis's position."""
        return not self.profile.position

    def simulation(
        self,
        *,
        timestep: float = SIMULATION_TIMESTEP,
        terrain: HeightField | None = None,
        latency: float | None = None,
        seed: int = 0,
        variation: Variation | None = None,
    ) -> Simulation:
        """Return a robot of this arena.

        Args:
            timestep: physics time step [s].
            terrain: height field to stand on; None for a plane.
            latency: age of the sensor readings [s]; None for the sensors' own.
            seed: seed of the sensors' noise, biases and offsets.
            variation: difference of the robot from its description.
        """
        return Simulation(
            timestep=timestep,
            terrain=terrain,
            sensing=self.profile,
            latency=latency,
            seed=seed,
            variation=variation,
            robot=load_robot(self.robot),
            actuators=DRIVES[self.drives],
        )
