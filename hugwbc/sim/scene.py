"""The MuJoCo model of the robot on its ground."""

import functools

import mujoco

from hugwbc.errors import ConfigError
from hugwbc.robot import load_robot
from hugwbc.sim.footing import add_footing
from hugwbc.sim.terrain import HeightField

TRAINING_TIMESTEP = 0.005  # [s], the paper's
SIMULATION_TIMESTEP = 0.002  # [s], one step for each tick of a 500 Hz torque controller


def load_model(timestep: float, terrain: HeightField | None = None, *, lean: bool = False) -> mujoco.MjModel:
    """Compile the H1 of `models/h1/h1.xml` on a plane or a height field.

    Args:
        timestep: physics time step [s].
        terrain: height field to stand on; None for a plane at z = 0.
        lean: leave out what does not influence the motion: visual shapes, the sensors of hands and IMU, and the search
            for contact islands (one robot is one island). The motion is the same bit by bit and takes a quarter less
            time.

    Raises:
        ConfigError: if the time step is not in (0, 0.01] s.
    """
    check_timestep(timestep)
    spec = mujoco.MjSpec.from_file(str(load_robot().xml_path))
    spec.option.timestep = timestep
    if lean:
        _make_lean(spec)
    if terrain is not None:
        _replace_floor(spec, terrain)
    return spec.compile()


def check_timestep(timestep: float) -> None:
    """Check that the robot can be simulated with a physics time step [s].

    Raises:
        ConfigError: if it is not in (0, 0.01] s.
    """
    if not 0.0 < timestep <= 0.01:
        raise ConfigError(f"physics time step is {timestep} s; give a value above 0 and up to 0.01 s")


@functools.cache
def robot_mass() -> float:
    """Return the mass of all links of the description [kg]."""
    return float(load_model(SIMULATION_TIMESTEP, lean=True).body_mass.sum())


def _make_lean(spec: mujoco.MjSpec) -> None:
    spec.compiler.discardvisual = True
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    for sensor in list(spec.sensors):
        if sensor.name.startswith("imu_") or sensor.name.endswith("_hand_position"):
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
