"""The MuJoCo model of the robot on its ground: how it is compiled, where the robot is in it, and how it may differ."""

import dataclasses
import functools
from typing import Annotated

import mujoco
import numpy as np
from pydantic import Field

from hugwbc import rotations
from hugwbc.errors import ConfigError, ModelError
from hugwbc.robot import Robot
from hugwbc.settings import Positive, settings
from hugwbc.sim.actuators import Actuators
from hugwbc.sim.footing import PLANE_NAME, add_footing
from hugwbc.sim.scenes.gripper import add_grips
from hugwbc.sim.scenes.scene import Scene, compiled
from hugwbc.sim.terrain import Ground, HeightField

TRAINING_TIMESTEP = 0.005  # [s], the paper's
SIMULATION_TIMESTEP = 0.002  # [s], one step for each tick of a 500 Hz torque controller
# What is held between two hands needs more iterations than a robot that stands: with few of them, forces of a
# grasp chatter and a box slips out. The solver stops by itself when it is done, after 10 to 20 in a grasp.
GRASP_ITERATIONS = 50
_POSE, _TWIST = 7, 6  # numbers of a free joint: position and quaternion; linear and angular velocity


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
        lean: leave out what does not influence the motion: visual shapes, the sensors of hand positions and IMU, and
            the search for contact islands (one robot is one island). The motion is the same bit by bit and takes a
            quarter less time.
        robot: robot to simulate.
        actuators: drives of the joints, whose friction and inertia the model gets; None for real ones.
        ground: firmness of the ground, and of objects other than movable ones; None for firm.
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
    model = compiled(spec)
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


@dataclasses.dataclass(frozen=True)
class Layout:
    """The robot's part of a model's state, found by the names of its joints."""

    qpos: slice  # pelvis position, quaternion (w, x, y, z) and joint positions in the order of `Robot.joint_names`
    qvel: slice  # pelvis velocity, angular velocity and joint velocities in the same order
    ctrl: slice  # the joints' actuators in the same order

    @functools.cached_property
    def joints(self) -> slice:
        """The joint positions alone."""
        return slice(self.qpos.start + _POSE, self.qpos.stop)

    @functools.cached_property
    def rates(self) -> slice:
        """The joint velocities alone."""
        return slice(self.qvel.start + _TWIST, self.qvel.stop)


def robot_layout(model: mujoco.MjModel, robot: Robot) -> Layout:
    """Find a robot in a model.

    The state arrays are shared with the physics: a part of them is a view only if it is without gaps.

    Raises:
        ModelError: if the pelvis, a joint or an actuator is missing, if the pelvis has no free joint, or if joints and
            actuators are not next to each other in the order of `Robot.joint_names`.
    """
    try:
        root = int(model.body(robot.base).jntadr[0])
        joints = [model.joint(name) for name in robot.joint_names]
        actuators = [model.actuator(name).id for name in robot.joint_names]
    except KeyError as error:
        raise ModelError(f"the model does not hold {robot.name}: {str(error.args[0]).splitlines()[0]}") from error
    count = len(robot.joint_names)
    first_q, first_v = int(model.jnt_qposadr[root]), int(model.jnt_dofadr[root])
    first = actuators[0]
    if (
        model.jnt_type[root] != mujoco.mjtJoint.mjJNT_FREE
        or [int(joint.qposadr[0]) for joint in joints] != list(range(first_q + _POSE, first_q + _POSE + count))
        or [int(joint.dofadr[0]) for joint in joints] != list(range(first_v + _TWIST, first_v + _TWIST + count))
        or actuators != list(range(first, first + count))
    ):
        raise ModelError(
            f"the model does not hold {robot.name} in one piece: after the free joint of the pelvis, the joints and "
            "actuators must follow in the order of the robot's table; generate its XML with models/build.py"
        )
    return Layout(
        slice(first_q, first_q + _POSE + count), slice(first_v, first_v + _TWIST + count), slice(first, first + count)
    )


@settings
class Variation:
    """Differences of one robot from its description; by default there are none.

    Attributes:
        payload: mass added at the trunk's centre of mass [kg]; negative to remove mass, less than the trunk's.
        friction: coefficient of sliding friction between robot and ground; None for that of the description.
        gain: factor on the stiffness and damping that a controller commands.
        strength: factor on the torque that the motors deliver, including their limit.
        hand_payload: mass in each hand, at its frame [kg].
    """

    payload: Annotated[float, Field(ge=-10.0, le=50.0)] = 0.0
    friction: Positive | None = None
    gain: Positive = 1.0
    strength: Positive = 1.0
    hand_payload: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0

    def loaded(self, mass: float) -> float:
        """Return the mass of a trunk with the payload [kg], from that without; refuse a sum that is not above 0."""
        if not mass + self.payload > 0.0:
            raise ConfigError(
                f"payload is {self.payload:g} kg, and the trunk weighs {mass:g} kg; remove less than that"
            )
        return mass + self.payload

    def apply_to(self, model: mujoco.MjModel, robot: Robot) -> None:
        """Change a newly compiled model of a robot.

        Only the torque limits take `strength` here; the simulation applies `gain` and `strength` to the PD law.
        """
        root = model.body(robot.base).id
        if self.payload:
            trunk = model.body(robot.trunk).id
            model.body_mass[trunk] = self.loaded(float(model.body_mass[trunk]))
            mujoco.mj_setConst(model, mujoco.MjData(model))
        if self.hand_payload:
            for link, hand in zip(robot.hand_links, robot.hands, strict=True):
                _add_mass(model, model.body(link).id, self.hand_payload, hand)
            mujoco.mj_setConst(model, mujoco.MjData(model))
        if self.friction is not None:
            # MuJoCo uses the larger of two coefficients, so the ground's must not exceed the requested one.
            ground = np.array([model.geom(i).name in ("floor", PLANE_NAME) for i in range(model.ngeom)])
            own = model.body_rootid[model.geom_bodyid] == root
            model.geom_friction[own, 0] = self.friction
            model.geom_friction[ground, 0] = np.minimum(model.geom_friction[ground, 0], self.friction)
        model.actuator_forcerange[robot_layout(model, robot).ctrl] *= self.strength


def _add_mass(model: mujoco.MjModel, body: int, mass: float, point: np.ndarray) -> None:
    """Add a point mass [kg] to a body, at a point in the body's frame [m]."""
    own, centre = float(model.body_mass[body]), model.body_ipos[body].copy()
    turn = rotations.to_matrix(model.body_iquat[body])
    middle = (own * centre + mass * point) / (own + mass)
    inertia = turn @ np.diag(model.body_inertia[body]) @ turn.T
    for part, place in ((own, centre), (mass, point)):
        arm = place - middle
        inertia += part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    principal, axes = np.linalg.eigh(inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))  # a rotation, not a reflection
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    model.body_mass[body], model.body_ipos[body] = own + mass, middle
    model.body_inertia[body], model.body_iquat[body] = principal, quaternion
