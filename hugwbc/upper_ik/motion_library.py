"""A library of arm motions made by the hand IK from a seed: hands that wander, circle and swing before the body."""

from collections.abc import Iterator

import numpy as np

from hugwbc.errors import ConfigError
from hugwbc.robot import load_robot
from hugwbc.scripts.hand_paths import Circle, HandPath, Swing, Wander
from hugwbc.scripts.motion import MOTION_FPS, ArmMotion
from hugwbc.scripts.script import HandMotion
from hugwbc.state import RobotState
from hugwbc.upper_ik.solver import ArmIK

# Centres of the left hand's paths in the pelvis frame [m]; the right hand's are drawn from the mirror image.
LOW, HIGH = np.array([0.15, 0.20, 0.0]), np.array([0.38, 0.38, 0.50])


def make_library(seed: int, count: int = 40, duration: float = 30.0) -> Iterator[ArmMotion]:
    """Arm motions at `MOTION_FPS`, the same for the same seed; by default 40 clips, 20 minutes.

    Args:
        seed: of the paths.
        count: of clips.
        duration: of each [s].

    Raises:
        ConfigError: if a number is not above 0, or the seed negative.
    """
    if seed < 0 or count < 1 or not 0.0 < duration < np.inf:
        raise ConfigError(f"seed is {seed}, count {count}, duration {duration} s; give 0 or more, 1 or more, above 0 s")
    return (_clip(seed, index, duration) for index in range(count))


def _clip(seed: int, index: int, duration: float) -> ArmMotion:
    rng = np.random.default_rng((seed, index))
    motion = HandMotion(_path(rng), _path(rng).mirrored())
    robot = load_robot()
    state = RobotState(robot.nominal, np.zeros(19), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
    ik, frames = ArmIK(), round(duration * MOTION_FPS) + 1
    positions = [ik.solve(motion.at(frame / MOTION_FPS), state, 1.0 / MOTION_FPS).q for frame in range(frames)]
    return ArmMotion(f"hands-{seed}-{index:02d}", MOTION_FPS, np.array(positions))


def _path(rng: np.random.Generator) -> HandPath:
    """A path of the left hand."""
    x, y, z = rng.uniform(LOW, HIGH).tolist()
    kind = int(rng.integers(3))
    if kind == 0:
        dx, dy, dz = rng.uniform((0.1, 0.1, 0.2), (0.3, 0.4, 0.6)).tolist()
        return Wander((x, y, z), (dx, dy, dz), leg_time=float(rng.uniform(0.6, 1.5)), seed=int(rng.integers(2**31)))
    if kind == 1:
        axis = ("x", "y", "z")[int(rng.integers(3))]
        return Circle((x, y, z), float(rng.uniform(0.04, 0.12)), axis, float(rng.uniform(1.5, 5.0)))
    ax, ay, az = rng.uniform(0.02, 0.12, 3).tolist()
    px, py, pz = rng.uniform(0.0, 1.0, 3).tolist()
    return Swing((x, y, z), (ax, ay, az), (px, py, pz), float(rng.uniform(1.0, 4.0)))
