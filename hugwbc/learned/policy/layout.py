"""What the networks read and return, part by part, and the sizes that follow; nothing of it needs torch."""

import math

from hugwbc.learned.policy.terms import TERMS, Part
from hugwbc.rotations import VECTOR_SIGNS

HISTORY_FRAMES = 5
TERRAIN_SHAPE = (17, 13)  # samples along x and y of the heading frame
TERRAIN_SPACING = 0.07  # [m]
TERRAIN_SIZE = math.prod(TERRAIN_SHAPE)

LINEAR_VELOCITY_SCALE = 2.0
LENGTH_SCALE = 5.0
FORCE_SCALE = 0.002
BIAS_SCALE, PAYLOAD_SCALE, LOAD_SCALE, MASS_SCALE, LATENCY_SCALE = 5.0, 0.25, 0.02, 5.0, 50.0

_VECTOR = tuple(VECTOR_SIGNS.tolist())

FRAME_TERMS = ("angular_velocity", "gravity", "joint_position", "joint_velocity", "last_action")
COMMAND_TERMS = ("command", "gait", "foot_sin", "foot_cos", "intervention")
FRAME = tuple(TERMS[name] for name in FRAME_TERMS)  # proprioception at one time
HISTORY = FRAME * HISTORY_FRAMES
COMMAND = tuple(TERMS[name] for name in COMMAND_TERMS)
ACTION = (Part("joint targets", "joints", "joints"),)
ESTIMATE = (
    Part("velocity of the pelvis in the heading frame", 3, _VECTOR, scale=LINEAR_VELOCITY_SCALE),
    Part("clearance of the left and the right sole", 2, (1.0,), sides=True, scale=LENGTH_SCALE),
    Part("pelvis height minus the nominal one", 1, (1.0,), scale=LENGTH_SCALE),
)
ESTIMATE_SIZE = sum(int(part.size) for part in ESTIMATE)
PRIVILEGED = (  # what the critic sees besides frame, command and terrain
    Part("velocity of the pelvis in the heading frame", 3, _VECTOR, scale=LINEAR_VELOCITY_SCALE),
    Part("measured minus commanded height", 1, (1.0,), scale=LENGTH_SCALE),
    Part("clearance of the left and the right sole", 2, (1.0,), sides=True, scale=LENGTH_SCALE),
    Part("friction coefficient", 1, (1.0,)),
    Part("ground reaction on the left and the right foot", 6, _VECTOR, sides=True, scale=FORCE_SCALE),
    Part("whether each link touches something", "links", "links"),
    Part("filtered errors of v_x, v_y and omega", 3, (1.0, -1.0, -1.0), scale=BIAS_SCALE),
    Part("payload of the left and the right hand", 2, (1.0,), sides=True, scale=PAYLOAD_SCALE),
    Part("force on the left and the right hand", 6, _VECTOR, sides=True, scale=LOAD_SCALE),
    Part("force on the trunk", 3, _VECTOR, scale=LOAD_SCALE),
    Part("mass of the robot, minus 1 of its description", 1, (1.0,), scale=MASS_SCALE),
    Part("latency", 1, (1.0,), scale=LATENCY_SCALE),
)
CRITIC_CORE = (*FRAME, *COMMAND, *PRIVILEGED)  # what is left of what it sees without the terrain

# Widths of the networks' layers.
LATENT_SIZE = 32
ENCODER_HIDDEN = (256, 128)
ESTIMATOR_HIDDEN = (64, 32)
POLICY_HIDDEN = (256, 128, 64)
CRITIC_HIDDEN = (512, 256, 128)
