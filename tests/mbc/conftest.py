"""Random states and a left-right symmetric H1 for the tests of `qp`."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from hugwbc import RobotState, load_robot, rotations
from hugwbc.kinematics import pinocchio_model
from hugwbc.mbc.dynamics import Dynamics
from tests.conftest import make_state


@pytest.fixture
def random_state() -> Callable[[np.random.Generator], RobotState]:
    """A maker of states near standing: upright to 0.3 rad, joints around nominal, everything moving."""
    robot = load_robot()

    def make(rng: np.random.Generator) -> RobotState:
        yaw, pitch, roll = rng.uniform(-3, 3), *rng.uniform(-0.3, 0.3, 2)
        return RobotState(
            q=np.clip(robot.nominal + rng.uniform(-0.2, 0.2, 19), robot.lower, robot.upper),
            dq=rng.uniform(-1, 1, 19),
            orientation=rotations.from_yaw_pitch_roll(yaw, pitch, roll),
            angular_velocity=rng.uniform(-1, 1, 3),
            position=rng.uniform(-3, 3, 3),
            velocity=rng.uniform(-1, 1, 3),
        )

    return make


def _reflected(inertia: pin.Inertia) -> pin.Inertia:
    flip = np.diag([1.0, -1.0, 1.0])
    return pin.Inertia(inertia.mass, flip @ inertia.lever, flip @ inertia.inertia @ flip)


@pytest.fixture(scope="session")
def symmetric_model() -> pin.Model:
    """The H1 with every link's inertia averaged with its mirror image's: the real table is a little lopsided."""
    model = pinocchio_model(load_robot()).copy()
    original = [inertia.copy() for inertia in model.inertias]
    for index, name in enumerate(model.names):
        other = name.replace("left_", "x_").replace("right_", "left_").replace("x_", "right_")
        mirrored = _reflected(original[model.getJointId(other)])
        own = original[index]
        mean = pin.Inertia(own.mass, (own.lever + mirrored.lever) / 2.0, (own.inertia + mirrored.inertia) / 2.0)
        model.inertias[index] = mean
    return model


@pytest.fixture
def standing_state() -> RobotState:
    """The nominal pose at rest on the ground."""
    return make_state(position=(0.0, 0.0, 0.98), velocity=np.zeros(3))


@pytest.fixture
def dynamics_of(standing_state: RobotState) -> Callable[..., Dynamics]:
    """A maker of the dynamics of the standing robot with some joints moved, at a yaw, and with other changes."""

    def make(yaw: float = 0.0, joints: dict[str, float] | None = None, **changes) -> Dynamics:
        q = standing_state.q.copy()
        for name, value in (joints or {}).items():
            q[load_robot().index(f"{name}_joint")] += value
        turned = {"q": q, "orientation": rotations.from_yaw_pitch_roll(yaw, 0.0, 0.0)}
        dynamics = Dynamics(load_robot())
        dynamics.update(dataclasses.replace(standing_state, **(turned | changes)))
        return dynamics

    return make


@pytest.fixture
def moved() -> Callable[[RobotState, np.ndarray, float], RobotState]:
    """A maker of the state after a small displacement along generalised velocities.

    The velocity has the base's linear velocity in the world, its angular velocity in the base, then the joints'.
    """

    def move(state: RobotState, velocity: np.ndarray, dt: float) -> RobotState:
        angle = np.linalg.norm(velocity[3:6]) * dt
        axis = velocity[3:6] / max(np.linalg.norm(velocity[3:6]), 1e-300)
        assert state.position is not None
        return dataclasses.replace(
            state,
            q=state.q + velocity[6:] * dt,
            orientation=rotations.multiply(state.orientation, rotations.from_axis_angle(axis, angle)),
            position=state.position + velocity[:3] * dt,
        )

    return move
