"""The robot's names, groups, limits and gains, read from the table `models/h1/h1.yaml`."""

import dataclasses
import functools
import pathlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import yaml

from hugwbc.errors import ModelError, UnknownNameError

SIDES = ("left", "right")
_LEG_PARTS = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle")
_ARM_PARTS = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")


def model_dir() -> pathlib.Path:
    """Return the folder of the robot description: inside an installed package, or next to it in a source checkout.

    Raises:
        ModelError: if neither exists.
    """
    package = pathlib.Path(__file__).parent
    for candidate in (package / "models" / "h1", package.parent / "models" / "h1"):
        if (candidate / "h1.yaml").is_file():
            return candidate
    raise ModelError(f"models/h1 was found neither in {package} nor next to it; reinstall hugwbc with its models")


@dataclasses.dataclass(frozen=True, eq=False)
class Robot:
    """Names, limits, gains and dimensions of the robot. Arrays follow `joint_names` and are read-only.

    Attributes:
        joint_names: names of the 19 joints, in the order of every joint vector.
        lower, upper: joint position limits [rad], shape (19,).
        velocity_limit: joint speed limits [rad/s], shape (19,).
        torque_limit: smaller of the maker's effort limit and the policy's torque clip [N*m], shape (19,).
        kp, kd: PD gains of the paper [N*m/rad], [N*m*s/rad], shape (19,).
        nominal: default joint positions [rad], shape (19,).
        axes: joint axes in the joint's own frame, shape (19, 3).
        armature: rotor inertia reflected to every joint [kg*m^2].
        damping: viscous friction of every joint [N*m*s/rad].
        nominal_height: height of the pelvis origin above flat ground at h = 0 [m].
        sole_x, sole_y: extent of the flat sole in the ankle link's frame [m].
        contact_links: links whose contacts the privileged observation flags.
    """

    joint_names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    velocity_limit: np.ndarray
    torque_limit: np.ndarray
    kp: np.ndarray
    kd: np.ndarray
    nominal: np.ndarray
    axes: np.ndarray
    armature: float
    damping: float
    nominal_height: float
    sole_x: tuple[float, float]
    sole_y: tuple[float, float]
    contact_links: tuple[str, ...]

    def index(self, name: str) -> int:
        """Return the position of a joint in every joint vector.

        Raises:
            UnknownNameError: if no joint has that name.
        """
        try:
            return self.joint_names.index(name)
        except ValueError:
            raise UnknownNameError("joint", name, self.joint_names) from None

    def indices(self, names: Sequence[str]) -> np.ndarray:
        """Return the positions of several joints in every joint vector, shape (n,)."""
        return np.array([self.index(name) for name in names])

    @functools.cached_property
    def legs(self) -> np.ndarray:
        """Indices of the ten leg joints, left leg first."""
        return self.indices([f"{side}_{part}_joint" for side in SIDES for part in _LEG_PARTS])

    @functools.cached_property
    def arms(self) -> np.ndarray:
        """Indices of the eight arm joints, left arm first: the upper body that external control may take over."""
        return self.indices([f"{side}_{part}_joint" for side in SIDES for part in _ARM_PARTS])

    @functools.cached_property
    def arm_names(self) -> tuple[str, ...]:
        """Names of the eight arm joints in the order of `arms`."""
        return tuple(self.joint_names[i] for i in self.arms)

    @functools.cached_property
    def waist(self) -> int:
        """Index of the waist yaw joint."""
        return self.index("torso_joint")

    @functools.cached_property
    def yaw_joints(self) -> np.ndarray:
        """Indices of the joints that turn the body about its vertical axis: hip yaw and waist."""
        waist = self.joint_names[self.waist]
        return self.indices([n for n in self.joint_names if n.endswith("hip_yaw_joint") or n == waist])

    @functools.cached_property
    def hip_yaw_roll(self) -> np.ndarray:
        """Indices of the four hip yaw and hip roll joints (the paper's hip x and z)."""
        return self.indices([f"{side}_{part}_joint" for side in SIDES for part in ("hip_yaw", "hip_roll")])

    @property
    def xml_path(self) -> pathlib.Path:
        """The MuJoCo description."""
        return model_dir() / "h1.xml"

    @property
    def urdf_path(self) -> pathlib.Path:
        """The URDF description."""
        return model_dir() / "h1.urdf"


def _frozen(values: Sequence[Any]) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    array.setflags(write=False)
    return array


@functools.cache
def load_robot() -> Robot:
    """Load the H1 of `models/h1/h1.yaml`.

    Raises:
        ModelError: if the table or one of its fields is missing.
    """
    path = model_dir() / "h1.yaml"
    table = yaml.safe_load(path.read_text())
    try:
        joints = table["joints"]
        return Robot(
            joint_names=tuple(joint["name"] for joint in joints),
            lower=_frozen([joint["range"][0] for joint in joints]),
            upper=_frozen([joint["range"][1] for joint in joints]),
            velocity_limit=_frozen([joint["velocity"] for joint in joints]),
            torque_limit=_frozen([min(joint["effort"], joint["policy_torque_limit"]) for joint in joints]),
            kp=_frozen([joint["kp"] for joint in joints]),
            kd=_frozen([joint["kd"] for joint in joints]),
            nominal=_frozen([joint["nominal"] for joint in joints]),
            axes=_frozen([joint["axis"] for joint in joints]),
            armature=float(table["armature"]),
            damping=float(table["damping"]),
            nominal_height=float(table["nominal_height"]),
            sole_x=tuple(table["sole"]["x"]),
            sole_y=tuple(table["sole"]["y"]),
            contact_links=tuple(table["contact_links"]),
        )
    except (KeyError, TypeError) as error:
        raise ModelError(f"{path} lacks the field {error}; restore it from the repository") from error
