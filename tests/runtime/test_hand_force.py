"""Forces on the hands from joint torques: the algebra, and in closed loop with the sensors of a robot."""

import numpy as np
import pinocchio as pin
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.kinematics import Kinematics
from hugwbc.runtime import UpperBodySource
from hugwbc.runtime.controllers import load_controller
from hugwbc.runtime.hand_force import HandForceObserver
from hugwbc.runtime.loop import ControlLoop
from hugwbc.scripts.command_source import Constant
from hugwbc.sim import Simulation
from hugwbc.sim.variation import Variation
from hugwbc.targets import HandTargets
from tests.conftest import make_state

DT = 0.002
REACHING = np.array([-0.9, 0.2, 0.1, 0.6, -0.9, -0.2, -0.1, 0.6])


@pytest.fixture
def kinematics():
    robot, found = load_robot(), Kinematics(load_robot())
    q = robot.nominal.copy()
    q[robot.arms] = REACHING
    found.update(make_state(q, position=[0.0, 0.0, 0.98]))
    pin.computeJointJacobians(found.model, found.data, found.q)
    return found


def felt(kinematics, forces):
    """The generalised force of forces on both hands, shape (25,)."""
    model, data = kinematics.model, kinematics.data
    hands = [kinematics.frame_id(f"{side}_hand") for side in ("left", "right")]
    jacobians = [pin.getFrameJacobian(model, data, hand, pin.LOCAL_WORLD_ALIGNED)[:3] for hand in hands]
    return sum(jacobian.T @ force for jacobian, force in zip(jacobians, forces, strict=True))


def test_forces_are_found_in_the_torques_that_they_cause(kinematics):
    observer, forces = HandForceObserver(kinematics), np.array([[10.0, -5.0, -29.0], [0.0, 20.0, 4.0]])
    residual = felt(kinematics, forces)
    for _ in range(1000):
        observer.infer(residual, DT)
    assert observer.force == pytest.approx(forces, rel=0.03, abs=0.5)
    assert felt(kinematics, observer.force) == pytest.approx(residual, abs=1.0), "nothing else is left to explain"
    observer.reset()
    assert not observer.force.any()


def test_forces_on_the_feet_alone_leave_the_hands_empty(kinematics):
    observer = HandForceObserver(kinematics)
    foot = pin.getFrameJacobian(
        kinematics.model, kinematics.data, kinematics.frame_id("left_sole"), pin.LOCAL_WORLD_ALIGNED
    )
    for _ in range(100):
        observer.infer(foot[:3].T @ [50.0, 20.0, 600.0], DT)
    assert np.abs(observer.force).max() < 1e-9


def test_friction_of_a_still_joint_is_the_limit(kinematics):
    """What the drives hold unseen shows up as a force of a few newtons."""
    observer, robot = HandForceObserver(kinematics), load_robot()
    residual = np.zeros(kinematics.model.nv)
    worst = 0.0
    for signs in np.array(np.meshgrid(*[[-1.0, 1.0]] * 4)).reshape(4, -1).T:
        residual[kinematics.columns[robot.arms[:4]]] = signs * robot.friction[robot.arms[:4]]
        observer.reset()
        for _ in range(1000):
            observer.infer(residual, DT)
        worst = max(worst, float(np.linalg.norm(observer.force[0])))
    assert 1.0 < worst < 8.0


@pytest.mark.slow
@pytest.mark.parametrize("payload", [0.0, 3.0])
def test_the_weight_in_the_hands_of_a_walking_robot(payload):
    simulation = Simulation(seed=3, variation=Variation(hand_payload=payload))
    # The policy's own arms lean on its torso, a force that the observer finds; targets keep them away from it.
    source = Constant(Command(v_x=0.3, gait=Gait.WALKING), HandTargets.of((0.3, 0.25, 0.1), (0.3, -0.25, 0.1)))
    arms = UpperBodySource(robot=simulation.known_robot)
    loop = ControlLoop(load_controller("learned"), source, simulation, arms)
    loop.reset()
    forces = []
    while simulation.time < 6.0:
        loop.step(loop.decide(simulation.time), loop.period)
        forces.append(loop.control.estimate.hand_force)
    assert not simulation.fallen
    mean = np.mean(forces[len(forces) // 2 :], axis=0)
    assert mean[:, 2] == pytest.approx([-9.81 * payload] * 2, abs=5.0)
    assert np.abs(mean[:, :2]).max() < 6.0
