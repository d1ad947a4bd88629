"""The MuJoCo model of the robot on its ground."""

import dataclasses
import math

import mujoco

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.robot import Robot, load_robot
from hugwbc.sim.actuators import Actuators
from hugwbc.sim.footing import add_footing
from hugwbc.sim.terrain import HeightField

TRAINING_TIMESTEP = 0.005  # [s], the paper's
SIMULATION_TIMESTEP = 0.002  # [s], one step for each tick of a 500 Hz torque controller


GROUNDS = ("firm", "soft")
CONES = {"pyramidal": mujoco.mjtCone.mjCONE_PYRAMIDAL, "elliptic": mujoco.mjtCone.mjCONE_ELLIPTIC}


@dataclasses.dataclass(frozen=True)
class Ground:
    """How firmly the robot stands: MuJoCo's settings of contacts, and of the solver that computes their forces.

    Attributes:
        time_constant: of the spring-damper that pushes a sole out of the ground (`solref`) [s]; MuJoCo raises it to two
            time steps if it is shorter.
        cone: friction cone, "pyramidal" or "elliptic".
        impratio: ratio of frictional to normal impedance; above 1 a standing foot creeps less.
        iterations: largest number of iterations of the solver.
    """

    time_constant: float = 0.005
    cone: str = "pyramidal"
    impratio: float = 1.0
    iterations: int = 20

    def __post_init__(self) -> None:
        if not 0.0 < self.time_constant < math.inf:
            raise ConfigError(f"time constant of the ground is {self.time_constant} s; give a finite time above 0 s")
        if self.cone not in CONES:
            raise UnknownNameError("friction cone", self.cone, tuple(CONES))
        if not 0.0 < self.impratio < math.inf:
            raise ConfigError(f"impratio of the ground is {self.impratio}; give a finite number above 0")
        if self.iterations < 1:
            raise ConfigError(f"the ground's solver has {self.iterations} iterations; give at least 1")

    @classmethod
    def named(cls, name: str) -> "Ground":
        """Return the firm ground of docs/arena.md, or the soft one of MuJoCo's default contacts.

        Raises:
            UnknownNameError: if the name is neither firm nor soft.
        """
        if name not in GROUNDS:
            raise UnknownNameError("ground", name, GROUNDS)
        return cls() if name == "firm" else cls(time_constant=0.02)

    def apply_to(self, model: mujoco.MjModel) -> None:
        """Set the contacts and the solver of a newly compiled model."""
        model.geom_solref[:, 0] = self.time_constant
        model.opt.cone = CONES[self.cone]
        model.opt.impratio = self.impratio
        model.opt.iterations = self.iterations


def load_model(
    timestep: float,
    terrain: HeightField | None = None,
    *,
    lean: bool = False,
    imu: bool = False,
    robot: Robot | None = None,
    actuators: Actuators | None = None,
    ground: Ground | None = None,
) -> mujoco.MjModel:
    """Compile a robot on a plane or a height field.

    Args:
        timestep: physics time step [s].
        terrain: height field to stand on; None for a plane at z = 0.
        lean: leave out what does not influence the motion: visual shapes, the sensors of hands and IMU, and the search
            for contact islands (one robot is one island). The motion is the same bit by bit and takes a quarter less
            time.
        imu: with `lean`, keep the gyro and the orientation of the IMU.
        robot: robot to simulate; None for the H1.
        actuators: drives of the joints, whose friction and inertia the model gets; None for real ones.
        ground: firmness of the ground; None for firm.

    Raises:
        ConfigError: if the time step is not in (0, 0.01] s.
    """
    check_timestep(timestep)
    robot = robot or load_robot()
    spec = mujoco.MjSpec.from_file(str(robot.xml_path))
    spec.option.timestep = timestep
    if lean:
        _make_lean(spec, imu=imu)
    if terrain is not None:
        _replace_floor(spec, terrain)
    model = spec.compile()
    (ground or Ground()).apply_to(model)
    (actuators or Actuators()).apply_to(model, robot)
    return model


def link_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the names of a model's bodies, by their numbers; the first is the world."""
    return tuple(model.body(i).name for i in range(model.nbody))


def check_timestep(timestep: float) -> None:
    """Check that the robot can be simulated with a physics time step [s].

    Raises:
        ConfigError: if it is not in (0, 0.01] s.
    """
    if not 0.0 < timestep <= 0.01:
        raise ConfigError(f"physics time step is {timestep} s; give a value above 0 and up to 0.01 s")


def _make_lean(spec: mujoco.MjSpec, *, imu: bool) -> None:
    dropped = () if imu else ("imu_orientation", "imu_gyro")
    spec.compiler.discardvisual = True
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    for sensor in list(spec.sensors):
        if sensor.name in dropped or sensor.name.endswith("_hand_position"):
            spec.delete(sensor)


def _replace_floor(spec: mujoco.MjSpec, terrain: HeightField) -> None:
    low, high = float(terrain.heights.min()), float(terrain.heights.max())
    elevation = max(high - low, 1e-6)
    rows, columns = terrain.heights.shape
    spec.add_hfield(
        name="terrain",
        size=[terrain.size[0] / 2, terrain.size[1] / 2, elevation, 0.1],
        nrow=rows,
        ncol=columns,
        userdata=((terrain.heights - low) / elevation).ravel(),
    )
    floor = spec.geom("floor")
    floor.type = mujoco.mjtGeom.mjGEOM_HFIELD
    floor.hfieldname = "terrain"
    floor.pos = [0.0, 0.0, low]
    add_footing(spec, terrain)
