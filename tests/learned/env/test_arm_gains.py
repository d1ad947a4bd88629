import numpy as np
import torch

from hugwbc.learned.config import ArmServoGains
from hugwbc.learned.env.arm_gains import ArmGains
from hugwbc.robot import load_robot
from hugwbc.sim.batch import BatchSimulation

ROBOT = load_robot("h1")


def torque(simulation: BatchSimulation, error: float, speed: float) -> np.ndarray:
    simulation.ctrl[:] = simulation.tensor(ROBOT.nominal + error)
    simulation.qpos[:, 7:] = simulation.tensor(ROBOT.nominal)
    simulation.qvel[:, 6:] = speed
    simulation.forward(torch.arange(simulation.count))
    return simulation.torque[:, ROBOT.arms].numpy()


def test_gains_go_from_the_policy_s_to_the_servo_s_and_back() -> None:
    simulation = BatchSimulation(3, robot=ROBOT)
    servo = ArmServoGains()
    gains = ArmGains(simulation, ROBOT, servo)
    stiffness, damping = servo.of(ROBOT)
    assert stiffness.tolist() == [140.0] * 8 and sorted(set(damping)) == [3.0, 10.0]
    own = torque(simulation, 0.05, 0.1)
    np.testing.assert_allclose(own, np.tile(0.05 * ROBOT.kp[ROBOT.arms] - 0.1 * ROBOT.kd[ROBOT.arms], (3, 1)))
    gains.update(torch.tensor([0.0, 1.0, 0.5]))
    mixed = torque(simulation, 0.05, 0.1)
    np.testing.assert_allclose(mixed[0], own[0])
    np.testing.assert_allclose(mixed[1], 0.05 * stiffness - 0.1 * damping)
    np.testing.assert_allclose(mixed[2], 0.5 * (mixed[0] + mixed[1]))
    gains.update(torch.zeros(3))
    np.testing.assert_allclose(torque(simulation, 0.05, 0.1), own)
