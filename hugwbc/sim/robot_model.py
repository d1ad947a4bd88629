"""The MuJoCo model of the robot on its ground."""

import mujoco
import numpy as np

from hugwbc.errors import ConfigError, SceneError
from hugwbc.robot import Robot
from hugwbc.sim.actuators import Actuators
from hugwbc.sim.footing import add_footing
from hugwbc.sim.ground import Ground
from hugwbc.sim.scenes.gripper import add_grips
from hugwbc.sim.scenes.scene import Scene
from hugwbc.sim.terrain import HeightField

TRAINING_TIMESTEP = 0.005  # [s], the paper's
SIMULATION_TIMESTEP = 0.002  # [s], one step for each tick of a 500 Hz torque controller
# What is held between two hands needs more iterations than a robot that stands: with few of them, forces of a
# grasp chatter and a box slips out. The solver stops by itself when it is done, after 10 to 20 in a grasp.
GRASP_ITERATIONS = 50


def load_model(
    timestep: float,
    terrain: HeightField | None = None,
    *,
    lean: bool = False,
    robot: Robot,
    actuators: Actuators | None = None,
    ground: Ground | None = None,
    scene: Scene | None = None,
) -> mujoco.MjModel:
    """Compile a robot on a plane or a height field, alone or among objects.

    Args:
        timestep: physics time step [s].
        terrain: height field to stand on; None for a plane at z = 0.
        lean: leave out what does not influence the motion: visual shapes, the sensors of hands and IMU, and the search
            for contact islands (one robot is one island). The motion is the same bit by bit and takes a quarter less
            time.
        robot: robot to simulate.
        actuators: drives of the joints, whose friction and inertia the model gets; None for real ones.
        ground: firmness of the ground, and of the objects; None for firm.
        scene: objects around the robot, drawn for one episode; None for none.
    """
    check_timestep(timestep)
    spec = mujoco.MjSpec.from_file(str(robot.xml_path))
    spec.option.timestep = timestep
    if lean:
        _make_lean(spec)
    if terrain is not None:
        _replace_floor(spec, terrain)
    model = spec.compile() if scene is None else _compile_with(scene, spec, terrain, robot)
    (ground or Ground()).apply_to(model)
    if scene is not None:
        model.opt.iterations = max(model.opt.iterations, GRASP_ITERATIONS)
    (actuators or Actuators()).apply_to(model, robot)
    return model


def _compile_with(scene: Scene, spec: mujoco.MjSpec, terrain: HeightField | None, robot: Robot) -> mujoco.MjModel:
    """Compile a robot's model with the objects of a scene, which start where the scene puts them."""
    scene.add_to(spec, terrain)
    add_grips(spec, scene.body_names, robot)
    # What lies still costs nothing until something touches it. MuJoCo never lets a robot sleep, because it has drives.
    spec.option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
    start = spec.keys[0]
    qpos = np.array(start.qpos)
    start.qpos, start.ctrl = [], []  # MuJoCo fills what is missing with the objects' own start
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise SceneError(f"MuJoCo refuses the scene: {' '.join(str(error).split())}") from error
    model.key_qpos[0, : qpos.size] = qpos  # the robot comes first, as `robot_layout` checks
    return model


def link_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the names of a model's bodies, by their numbers; the first is the world."""
    return tuple(model.body(i).name for i in range(model.nbody))


def check_timestep(timestep: float) -> None:
    """Check that the robot can be simulated with a physics time step [s]."""
    if not 0.0 < timestep <= 0.01:
        raise ConfigError(f"physics time step is {timestep} s; give a value above 0 and up to 0.01 s")


def _make_lean(spec: mujoco.MjSpec) -> None:
    spec.compiler.discardvisual = True
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    for sensor in list(spec.sensors):
        if sensor.name in ("imu_orientation", "imu_gyro") or sensor.name.endswith("_hand_position"):
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
