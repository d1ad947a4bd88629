"""Hand targets to arm joints: inverse kinematics and the takeover of the arms."""

from hugwbc.upper_ik.body_reach import BodyReach, BodyReachConfig
from hugwbc.upper_ik.config import ArmIKConfig
from hugwbc.upper_ik.solver import ArmIK, IKSolution
from hugwbc.upper_ik.source import TargetCounts, TargetWatch, UpperBodySource
from hugwbc.upper_ik.takeover import Takeover, TakeoverConfig

__all__ = [
    "ArmIK",
    "ArmIKConfig",
    "BodyReach",
    "BodyReachConfig",
    "IKSolution",
    "Takeover",
    "TakeoverConfig",
    "TargetCounts",
    "TargetWatch",
    "UpperBodySource",
]
