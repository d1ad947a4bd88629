"""Public policies for a G1 that also take the body's height, and that a contract cannot describe; beside ours.

    hugwbc evaluate single-command --robot g1 --controller tools/public_controllers.py:Homie --policy deploy.onnx
    hugwbc compare --robot g1 --controllers qp learned tools/public_controllers.py:Falcon=g1_29dof.onnx

Their networks are not part of hugwbc: HomieDeploy/deploy.onnx of InternRobotics/OpenHomie (CC BY-NC, commit cefcd85),
sim2real/models/falcon/g1_29dof.onnx of LeCAR-Lab/FALCON (MIT, commit 25ad085). Numbers and the order of the observation
come from HomieDeploy (g1_gym_deploy/envs/lcm_agent.py; gains: unitree_sdk2/g1_control.cpp), and from sim2real
(config/g1/g1_29dof_falcon.yaml, rl_policy). Both are told a height over the ground, which a contract does not know;
FALCON also whether it walks, and where the arms should be.
"""

import pathlib

import numpy as np

from hugwbc import Command, Gait, JointCommand, RobotState, UpperBody, load_robot
from hugwbc.controller import override_arms
from hugwbc.errors import ConfigError
from hugwbc.learned.policy.network_files import load_network

LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
WAIST = ("waist_yaw_joint", "waist_roll_joint", "waist_pitch_joint")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
LEGS = tuple(f"{side}_{joint}_joint" for side in ("left", "right") for joint in LEG)
ARMS = tuple(f"{side}_{joint}_joint" for side in ("left", "right") for joint in ARM)
BENT = (-0.1, 0.0, 0.0, 0.3, -0.2, 0.0) * 2  # of the legs at action 0 [rad]; all other joints are at 0
SCALE = 0.25  # [rad] of a joint target for an action of 1
CLIP = 100.0  # of the actions


class PublicPolicy:
    """A network that reads the last frames, oldest first, and moves the first of its joints."""

    name: str
    period = 0.02
    frames: int  # that the network reads
    joints: tuple[str, ...]  # in the order of the network
    kp: tuple[float, ...]
    kd: tuple[float, ...]
    height: float  # [m], of the pelvis over the ground, that it is told for h = 0

    def __init__(self, policy: str | None = None) -> None:
        """Load the network of an ONNX file."""
        if policy is None:
            raise ConfigError(f"{self.name} has no network; give the ONNX file with --policy, see {__file__}")
        self.robot = load_robot("g1")
        self._network = load_network(pathlib.Path(policy), {})
        self._places = self.robot.indices(self.joints)
        self._pose = np.concatenate((BENT, np.zeros(len(self.joints) - len(BENT))))
        self._gains = self.robot.kp.copy(), self.robot.kd.copy()
        for mine, of_network in zip(self._gains, (self.kp, self.kd), strict=True):
            mine[self._places] = of_network
        self._past: list[np.ndarray] = []
        self._action = np.zeros(0)

    def reset(self, state: RobotState) -> None:
        """Forget the past."""
        self._past, self._action = [], np.zeros(self.actions)

    @property
    def actions(self) -> int:
        """How many of its joints the network moves."""
        return len(self.joints)

    def frame(self, state: RobotState, command: Command, arms: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the parts of an observation; `arms` is where the arms should be [rad], shape (14,)."""
        raise NotImplementedError

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return the joint targets of the network."""
        arms = np.where(upper_body.mask, upper_body.q, 0.0)
        frame = np.concatenate([np.atleast_1d(part) for part in self.frame(state, command, arms)])
        past = [*self._past, frame]
        self._past = [*[np.zeros_like(frame)] * (self.frames - len(past)), *past][-self.frames :]
        action = self._network([np.concatenate(self._past).astype(np.float32)])
        self._action = np.clip(np.nan_to_num(action), -CLIP, CLIP).astype(float)
        q = self.robot.nominal.copy()
        q[self._places], q[self.robot.arms] = self._pose, arms
        q[self._places[: self.actions]] += SCALE * self._action
        if self.robot.waist not in self._places[: self.actions]:
            q[self.robot.waist] = command.w
        zero = np.zeros_like(q)
        return JointCommand(q, zero, *self._gains, zero)

    def _joint_readings(self, state: RobotState) -> tuple[np.ndarray, np.ndarray]:
        """Return positions relative to those at action 0 and scaled velocities of its joints."""
        return state.q[self._places] - self._pose, 0.05 * state.dq[self._places]


class Homie(PublicPolicy):
    """The policy of HOMIE (Ben et al., RSS 2025): it moves the legs, whatever moves waist and arms."""

    name = "homie"
    frames = 6
    joints = (*LEGS, WAIST[0], *ARMS)
    kp = (*(150.0, 150.0, 150.0, 300.0, 40.0, 40.0) * 2, 300.0, *(150.0, 150.0, 150.0, 100.0, 10.0, 10.0, 5.0) * 2)
    kd = (*(2.0, 2.0, 2.0, 4.0, 2.0, 2.0) * 2, 5.0, *(4.0, 4.0, 4.0, 1.0, 0.5, 0.5, 0.5) * 2)
    height = 0.74

    @property
    def actions(self) -> int:
        """How many of its joints the network moves."""
        return len(LEGS)

    def frame(self, state: RobotState, command: Command, arms: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return command, angular velocity, gravity, joints, and the last actions."""
        told = np.array([2.0 * command.v_x, 2.0 * command.v_y, 0.25 * command.omega, self.height + command.h])
        return told, 0.5 * state.angular_velocity, state.projected_gravity, *self._joint_readings(state), self._action

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return its joint targets; arms under external control follow their servo."""
        return override_arms(super().act(state, command, upper_body), upper_body, self.robot)


class Falcon(PublicPolicy):
    """The policy of FALCON (Zhang et al., 2025): it moves all joints, the arms about where they should be.

    It was trained to change height and waist in stands only, and is told neither in a walk.
    """

    name = "falcon"
    frames = 5
    joints = (*LEGS, *WAIST, *ARMS)
    kp = (*(100.0, 100.0, 100.0, 200.0, 20.0, 20.0) * 2, *(300.0,) * 3, *(90.0, 60.0, 20.0, 60.0, 4.0, 4.0, 4.0) * 2)
    kd = (*(2.5, 2.5, 2.5, 5.0, 0.2, 0.1) * 2, *(5.0,) * 3, *(2.0, 1.0, 0.4, 1.0, 0.2, 0.2, 0.2) * 2)
    height = 0.75

    def frame(self, state: RobotState, command: Command, arms: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the parts in the alphabetical order of their names in FALCON."""
        position, velocity = self._joint_readings(state)
        walks = command.gait is not Gait.STANDING
        h, w = (0.0, 0.0) if walks else (command.h, command.w)
        return (
            self._action,
            0.25 * state.angular_velocity,
            np.array([command.omega, 2.0 * (self.height + h), command.v_x, command.v_y]),
            np.array([float(walks), w, 0.0, 0.0]),
            position,
            velocity,
            state.projected_gravity,
            arms,
        )
