import mujoco
import numpy as np
import pytest

from hugwbc import rotations
from hugwbc.controller import JointCommand
from hugwbc.sim import Simulation
from hugwbc.state import RobotState

ARMS = np.array([-0.5, 0.2, 0.1, 0.3, -0.4, -0.3, -0.1, 0.2])  # a posture
REACHING = np.array([-0.9, 0.2, 0.1, 0.6, -0.9, -0.2, -0.1, 0.6])  # both arms forward, elbows slightly bent
LIMIT = np.array([9.0, 9.0, 20.0, 20.0] * 2)  # the maker's joint speeds [rad/s], from h1.yaml


class Hanging:
    """The robot in MuJoCo with the pelvis held still in the air, at a pitch: joints move, the base does not."""

    def __init__(self, pitch=0.0, actuators=None):
        self.simulation = Simulation(actuators=actuators)
        # A pelvis of 10^5 kg does not move noticeably within one step, and is put back after it. With 10^6 kg the
        # solver no longer resolves the friction of light joints, which then chatter.
        self.simulation.model.dof_armature[:6] = 1e5
        self.pose = np.array([0.0, 0.0, 1.6, *rotations.from_yaw_pitch_roll(0.4, pitch, 0.0)])
        self.state = self._put_back()

    def _put_back(self):
        data = self.simulation.data
        data.qpos[:7], data.qvel[:6] = self.pose, 0.0
        mujoco.mj_forward(self.simulation.model, data)
        return self.simulation.state()

    def step(self, command: JointCommand, duration: float) -> RobotState:
        for _ in range(round(duration / self.simulation.timestep)):
            self.simulation.step(command, self.simulation.timestep)
            self.state = self._put_back()
        return self.state

    def hands(self):
        """In the pelvis frame, shape (2, 3)."""
        world = np.array([self.simulation.hand_position(side) for side in ("left", "right")])
        return rotations.rotate_inverse(self.pose[3:], world - self.pose[:3])


@pytest.fixture
def hanging():
    return Hanging
