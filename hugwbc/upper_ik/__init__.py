"""Hand targets to arm joints: inverse kinematics, gravity compensation, and the hand-over of the arms and back."""

from hugwbc.upper_ik.body_reach import BodyReach, BodyReachConfig
from hugwbc.upper_ik.config import ArmIKConfig
from hugwbc.upper_ik.gravity import ArmDamping, GravityCompensation
from hugwbc.upper_ik.hand_back import HandBack
from hugwbc.upper_ik.solver import ArmIK, IKSolution
from hugwbc.upper_ik.takeover import Takeover, TakeoverConfig, UpperBodySource
from hugwbc.upper_ik.watch import TargetCounts, TargetWatch

__all__ = [
    "ArmDamping",
    "ArmIK",
    "ArmIKConfig",
    "BodyReach",
    "BodyReachConfig",
    "GravityCompensation",
    "HandBack",
    "IKSolution",
    "Takeover",
    "TakeoverConfig",
    "TargetCounts",
    "TargetWatch",
    "UpperBodySource",
]
