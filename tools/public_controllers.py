"""Public policies for a G1 that also take the body's height, and that a contract alone cannot describe; beside ours.

    hugwbc evaluate single-command --robot g1 --controller tools/public_controllers.py:Homie --policy deploy.onnx
    hugwbc compare --robot g1 --controllers qp learned tools/public_controllers.py:Falcon=g1_29dof.onnx

Their networks are not part of hugwbc: HomieDeploy/deploy.onnx of InternRobotics/OpenHomie (CC BY-NC, commit cefcd85),
sim2real/models/falcon/g1_29dof.onnx of LeCAR-Lab/FALCON (MIT, commit 25ad085). Numbers and the order of the observation
come from HomieDeploy (g1_gym_deploy/envs/lcm_agent.py; gains: unitree_sdk2/g1_control.cpp), and from sim2real
(config/g1/g1_29dof_falcon.yaml, rl_policy). Both are told a height over the ground, not above a stand; FALCON also
whether it walks, and where the arms should be.
"""

import dataclasses
import pathlib

import numpy as np

from hugwbc import Command, Gait, JointCommand, RobotState, UpperBody, load_robot
from hugwbc.errors import ConfigError
from hugwbc.learned.policy.contract import Contract, History, Term
from hugwbc.learned.policy.network_files import Network, load_network
from hugwbc.learned.policy.network_policy import NetworkPolicy, tried
from hugwbc.learned.policy.terms import TERMS, ObservationTerm

ROBOT = load_robot("g1")
LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
LEGS = tuple(f"{side}_{joint}_joint" for side in ("left", "right") for joint in LEG)
WAIST = ("waist_yaw_joint", "waist_roll_joint", "waist_pitch_joint")
ARMS = ROBOT.arm_names
BENT = (-0.1, 0.0, 0.0, 0.3, -0.2, 0.0) * 2  # of the legs at action 0 [rad]; all other joints are at 0
SHARED = {"robot": "g1", "period": 0.02, "action_scale": 0.25, "action_clip": 100.0}

TERMS["walks"] = ObservationTerm(
    about="1 in a gait with steps, else 0", size=1, signs=(1.0,), read=lambda s: (s.gait != int(Gait.STANDING))[:, None]
)
TERMS["arm_pose"] = ObservationTerm(
    about="positions of the arms at action 0",
    size=len(ARMS),
    signs=(1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0),
    sides=True,
    read=lambda s: np.broadcast_to(s.pose[ROBOT.arms], (len(s.gait), len(ARMS))),
)

HOMIE = Contract(
    **SHARED,
    name="homie",
    joints=LEGS,
    default_pose=BENT,
    kp=(150.0, 150.0, 150.0, 300.0, 40.0, 40.0) * 2,
    kd=(2.0, 2.0, 2.0, 4.0, 2.0, 2.0) * 2,
    held_pose=dict.fromkeys(ARMS, 0.0),
    waist_rate=100.0,  # at once
    history=History(6, start="zeros"),
    observation=(
        Term("command", names=("v_x", "v_y", "omega", "h"), scale=(2.0, 2.0, 0.25, 1.0)),
        Term("angular_velocity", scale=0.5),
        Term("gravity"),
        Term("joint_position", joints=(*LEGS, WAIST[0], *ARMS)),
        Term("joint_velocity", joints=(*LEGS, WAIST[0], *ARMS), scale=0.05),
        Term("last_action"),
    ),
)
FALCON = Contract(
    **SHARED,
    name="falcon",
    joints=(*LEGS, *WAIST, *ARMS),
    default_pose=(*BENT, *(0.0,) * 17),
    kp=(*(100.0, 100.0, 100.0, 200.0, 20.0, 20.0) * 2, *(300.0,) * 3, *(90.0, 60.0, 20.0, 60.0, 4.0, 4.0, 4.0) * 2),
    kd=(*(2.5, 2.5, 2.5, 5.0, 0.2, 0.1) * 2, *(5.0,) * 3, *(2.0, 1.0, 0.4, 1.0, 0.2, 0.2, 0.2) * 2),
    history=History(5, start="zeros"),
    observation=(  # in the alphabetical order of FALCON's names
        Term("last_action"),
        Term("angular_velocity", scale=0.25),
        Term("command", names=("omega",)),
        Term("command", names=("h",), scale=2.0),
        Term("command", names=("v_x", "v_y")),
        Term("walks"),
        Term("command", names=("w",)),
        Term("constant", value=(0.0, 0.0)),
        Term("joint_position", joints=(*LEGS, *WAIST)),
        Term("absolute_joint_position", joints=ARMS),
        Term("joint_velocity", scale=0.05),
        Term("gravity"),
        Term("arm_pose"),
    ),
)


def network_of(contract: Contract, policy: str | None) -> Network:
    """Load the network of an ONNX file, and check that it fits."""
    if policy is None:
        raise ConfigError(f"{contract.name} has no network; give the ONNX file with --policy, see {__file__}")
    path = pathlib.Path(policy)
    return tried(load_network(path, {}), contract, path)


class Homie(NetworkPolicy):
    """The policy of HOMIE (Ben et al., RSS 2025): it moves the legs, whatever moves waist and arms."""

    def __init__(self, policy: str | None = None) -> None:
        """Load the network of an ONNX file."""
        super().__init__(HOMIE, network_of(HOMIE, policy))
        held = self.robot.indices((WAIST[0], *ARMS))
        self._kp[held] = (300.0, *(150.0, 150.0, 150.0, 100.0, 10.0, 10.0, 5.0) * 2)
        self._kd[held] = (5.0, *(4.0, 4.0, 4.0, 1.0, 0.5, 0.5, 0.5) * 2)

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return joint targets; arms under external control follow their servo."""
        return super().act(state, dataclasses.replace(command, h=0.74 + command.h), upper_body)


class Falcon(NetworkPolicy):
    """The policy of FALCON (Zhang et al., 2025): it moves all joints, the arms about where they should be.

    It was trained to change height and waist in stands only, and is told neither in a walk.
    """

    def __init__(self, policy: str | None = None) -> None:
        """Load the network of an ONNX file."""
        super().__init__(FALCON, network_of(FALCON, policy))

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return joint targets; those of the arms are the network's about the external ones."""
        self._pose[self.robot.arms] = np.where(upper_body.mask, upper_body.q, 0.0)
        h, w = (command.h, command.w) if command.gait is Gait.STANDING else (0.0, 0.0)
        told = dataclasses.replace(command, h=0.75 + h, w=w)
        return super().act(state, told, UpperBody.none(len(self.robot.arms)))
