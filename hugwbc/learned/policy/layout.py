"""What a policy network reads and returns, part by part; nothing of it needs torch.

A part is declared once, with size, scale, noise and mirror image. Sizes, contracts, noise and mirror maps follow.
"""

import dataclasses
import functools
import math
from collections.abc import Iterable
from typing import Literal

import numpy as np

from hugwbc.commands import COMMAND_NAMES
from hugwbc.gait import Gait
from hugwbc.mirror import AXIAL_SIGNS, COMMAND_SIGNS, VECTOR_SIGNS, load_mirror
from hugwbc.robot import load_robot

JOINTS = 19
HISTORY_FRAMES = 5
TERRAIN_SHAPE = (17, 13)  # samples along x and y of the heading frame
TERRAIN_SPACING = 0.07  # [m]
TERRAIN_SIZE = math.prod(TERRAIN_SHAPE)

ANGULAR_VELOCITY_SCALE = 0.25
JOINT_VELOCITY_SCALE = 0.05
LINEAR_VELOCITY_SCALE = 2.0
LENGTH_SCALE = 5.0
FORCE_SCALE = 0.002
BIAS_SCALE, PAYLOAD_SCALE, LOAD_SCALE, MASS_SCALE, LATENCY_SCALE = 5.0, 0.25, 0.02, 5.0, 50.0
# Order of the command observation, with the scale that brings each command to about 1. These scales are ours: the
# authors scale l by 0.15, which hides it from the network.
COMMAND_SCALES = {"v_x": 2.0, "v_y": 2.0, "omega": 1.0, "f": 1.0, "l": 4.0, "h": 2.0, "p": 2.0, "w": 1.0}

_VECTOR, _AXIAL = tuple(VECTOR_SIGNS.tolist()), tuple(AXIAL_SIGNS.tolist())


@dataclasses.dataclass(frozen=True)
class Part:
    """A few numbers of an observation that belong together.

    Attributes:
        about: what they are, for contracts.
        size: how many they are.
        signs: factors, +1 or -1, that make the mirror image of the numbers; "joints", "gaits" or "links" for numbers in
            the order of the robot's joints, of `Gait` or of `Robot.contact_links`.
        sides: whether they are those of the left side, then those of the right one: in a mirror image the two change
            places, and `signs` are those of one side.
        scale: factor that brings them to about 1.
        noise: half-width of the noise, in physical units. `RandomizationConfig.noise` scales that of our own parts,
            which is the paper's; terms of other packages always have theirs in training, and never elsewhere.
    """

    about: str
    size: int
    signs: tuple[float, ...] | Literal["joints", "gaits", "links"]
    sides: bool = False
    scale: float = 1.0
    noise: float = 0.0

    def image(self) -> tuple[np.ndarray, np.ndarray]:
        """Return partner and sign of each number: image_i = sign_i x_partner_i."""
        if self.signs == "joints":
            mirror = load_mirror()
            return mirror.joint_index, mirror.joint_sign
        if self.signs == "gaits":
            return np.array([int(gait.mirrored()) for gait in Gait]), np.ones(len(Gait))
        if self.signs == "links":
            names, swap = list(load_robot().contact_links), {"left": "right", "right": "left"}
            partners = ["_".join([swap.get(word, word) for word in name.split("_")]) for name in names]
            return np.array([names.index(name) for name in partners]), np.ones(len(names))
        places, half = np.arange(self.size), self.size // 2
        if not self.sides:
            return places, np.array(self.signs)
        return (places + half) % self.size, np.tile(self.signs, 2)


def size_of(parts: Iterable[Part]) -> int:
    """Return how many numbers parts have together."""
    return sum(part.size for part in parts)


FRAME = (  # proprioception at one time
    Part("angular velocity of the pelvis in its own frame", 3, _AXIAL, scale=ANGULAR_VELOCITY_SCALE, noise=0.2),
    Part("unit vector of gravity in the pelvis frame", 3, _VECTOR, noise=0.05),
    Part("q - nominal", JOINTS, "joints", noise=0.01),
    Part("dq", JOINTS, "joints", scale=JOINT_VELOCITY_SCALE, noise=1.5),
    Part("last action", JOINTS, "joints"),
)
COMMAND = (
    *(
        Part(name, 1, (sign,), scale=COMMAND_SCALES[name])
        for name, sign in zip(COMMAND_NAMES, COMMAND_SIGNS.tolist(), strict=True)
    ),
    Part("1 for the gait, else 0: " + ", ".join(gait.label for gait in Gait), len(Gait), "gaits"),
    Part("sin(2 pi phase) of the left and the right foot", 2, (1.0,), sides=True),
    Part("cos(2 pi phase) of the left and the right foot", 2, (1.0,), sides=True),
    Part("intervention indicator: arms under external control", 1, (1.0,)),
)
ESTIMATE = (
    Part("velocity of the pelvis in the heading frame", 3, _VECTOR, scale=LINEAR_VELOCITY_SCALE),
    Part("clearance of the left and the right sole", 2, (1.0,), sides=True, scale=LENGTH_SCALE),
    Part("pelvis height minus the nominal one", 1, (1.0,), scale=LENGTH_SCALE),
)
PRIVILEGED = (  # what the critic sees besides frame, command and terrain
    Part("velocity of the pelvis in the heading frame", 3, _VECTOR, scale=LINEAR_VELOCITY_SCALE),
    Part("measured minus commanded height", 1, (1.0,), scale=LENGTH_SCALE),
    Part("clearance of the left and the right sole", 2, (1.0,), sides=True, scale=LENGTH_SCALE),
    Part("friction coefficient", 1, (1.0,)),
    Part("ground reaction on the left and the right foot", 6, _VECTOR, sides=True, scale=FORCE_SCALE),
    Part("whether each link touches something", 11, "links"),
    Part("filtered errors of v_x, v_y and omega", 3, (1.0, -1.0, -1.0), scale=BIAS_SCALE),
    Part("payload of the left and the right hand", 2, (1.0,), sides=True, scale=PAYLOAD_SCALE),
    Part("force on the left and the right hand", 6, _VECTOR, sides=True, scale=LOAD_SCALE),
    Part("force on the trunk", 3, _VECTOR, scale=LOAD_SCALE),
    Part("mass of the robot, minus 1 of its description", 1, (1.0,), scale=MASS_SCALE),
    Part("latency", 1, (1.0,), scale=LATENCY_SCALE),
)
PROPRIOCEPTION_SIZE, COMMAND_SIZE = size_of(FRAME), size_of(COMMAND)
ESTIMATE_SIZE, PRIVILEGED_SIZE = size_of(ESTIMATE), size_of(PRIVILEGED)
CRITIC_CORE_SIZE = PROPRIOCEPTION_SIZE + COMMAND_SIZE + PRIVILEGED_SIZE  # what is left of it without the terrain
CRITIC_SIZE = CRITIC_CORE_SIZE + TERRAIN_SIZE

# Widths of the policy's layers.
LATENT_SIZE = 32
ACTION_SIZE = JOINTS
ENCODER_HIDDEN = (256, 128)
ESTIMATOR_HIDDEN = (64, 32)
POLICY_HIDDEN = (256, 128, 64)


@functools.cache
def command_scales() -> np.ndarray:
    """Return the scales of the eight commands in the observation, shape (8,), float32."""
    return np.array([COMMAND_SCALES[name] for name in COMMAND_NAMES], dtype=np.float32)
