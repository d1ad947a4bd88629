"""Hand targets to arm joints: inverse kinematics, the takeover of the arms, and the servo that drives them."""

from hugwbc.upper_ik.body_reach import BodyReach, BodyReachConfig
from hugwbc.upper_ik.config import ArmIKConfig
from hugwbc.upper_ik.servo import ArmServo, ArmServoConfig
from hugwbc.upper_ik.solver import ArmIK, IKSolution
from hugwbc.upper_ik.source import TargetCounts, TargetWatch, UpperBodySource
from hugwbc.upper_ik.takeover import Takeover, TakeoverConfig

__all__ = [
    "ArmIK",
    "ArmIKConfig",
    "ArmServo",
    "ArmServoConfig",
    "BodyReach",
    "BodyReachConfig",
    "IKSolution",
    "Takeover",
    "TakeoverConfig",
    "TargetCounts",
    "TargetWatch",
    "UpperBodySource",
]
