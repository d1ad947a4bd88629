"""Hand targets to arm joints: inverse kinematics and the takeover of the arms."""

from hugwbc.upper_ik.arm_solver import ArmIKConfig
from hugwbc.upper_ik.body_reach import BodyReach
from hugwbc.upper_ik.solver import ArmIK, IKSolution
from hugwbc.upper_ik.source import TargetWatch, UpperBodySource
from hugwbc.upper_ik.takeover import Takeover

__all__ = [
    "ArmIK",
    "ArmIKConfig",
    "BodyReach",
    "IKSolution",
    "Takeover",
    "TargetWatch",
    "UpperBodySource",
]
