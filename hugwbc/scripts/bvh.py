"""BVH clips of a person: the positions of the joints that a whole-body motion needs, in our axes.

The file is read by pybvh (extra `[motion]`). Units stay those of the file, often centimetres: whoever uses the clip
scales it by the lengths of legs and arms.
"""

import dataclasses
import itertools
import pathlib
import re
import warnings

import numpy as np

from hugwbc.errors import MotionFileError, needing
from hugwbc.scripts.motion import FRAME_RATES

# The names of the common conventions, in lower case and without prefixes, spaces and underscores: first those of CMU,
# LAFAN and Mixamo, then others.
_NAMES = {
    "hip": ("{}upleg", "{}upperleg", "{}hip", "{}thigh", "upleg{}", "thigh{}"),
    "knee": ("{}leg", "{}lowerleg", "{}knee", "{}shin", "{}calf", "shin{}"),
    "ankle": ("{}foot", "{}ankle", "foot{}"),
    "shoulder": ("{}arm", "{}upperarm", "{}uparm", "upperarm{}", "{}shoulder"),
    "elbow": ("{}forearm", "{}lowerarm", "{}elbow", "{}lowarm", "forearm{}"),
    "wrist": ("{}hand", "{}wrist", "hand{}"),
}
_SIDES = {"left": ("left", "l"), "right": ("right", "r")}
JOINTS = tuple(_NAMES)
# Cyclic permutations and half turns that bring one signed axis of the file to z; each keeps left and right apart.
_TO_Z_UP = (
    np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    np.eye(3),
)
_HALF_TURN = np.diag([1.0, -1.0, -1.0])
_SHORTEST = 1e-6  # length of a limb in units of the file below which it is missing


@dataclasses.dataclass(frozen=True, eq=False)
class BodyClip:
    """Positions of a person's joints over time; x and y level, z up, left and right as the person's.

    Attributes:
        name: name of the clip, such as that of its file.
        fps: frames per second.
        joints: positions of the left and the right joint by name (`JOINTS`), in the units of the file, shape
            (frames, 2, 3) each.
        unused: joints of the file that are not read.
    """

    name: str
    fps: float
    joints: dict[str, np.ndarray]
    unused: tuple[str, ...] = ()

    def length(self, *joints: str) -> float:
        """Return the length of a chain of joints, the median over both sides and time, in the units of the file."""
        pairs = itertools.pairwise(joints)
        return float(np.median(sum(np.linalg.norm(self.joints[b] - self.joints[a], axis=-1) for a, b in pairs)))


def load_bvh(path: str | pathlib.Path) -> BodyClip:
    """Read a BVH file of a person.

    The axis that points up is the one along which the shoulders are above the feet.
    """
    path = pathlib.Path(path)
    with needing("motion", f"reading {path}"):
        import pybvh
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pybvh's guesses of axes and floor, which are not used
            read = pybvh.read_bvh_file(path, world_up="+y")
            positions, fps = read.joint_positions(), float(read.fps)
        names = list(read.joint_names)
    except (OSError, ValueError, IndexError, KeyError, TypeError, ZeroDivisionError) as error:
        words = str(error).replace("\n", " ")
        raise MotionFileError(
            f"cannot read {path}: {words}; give a BVH file with positions of the root and rotations of every joint"
        ) from error
    if len(positions) < 2 or not np.all(np.isfinite(positions)):
        raise MotionFileError(f"{path} holds fewer than 2 frames or numbers that are not finite; repair the motion")
    if not FRAME_RATES[0] <= fps <= FRAME_RATES[1]:
        raise MotionFileError(f"{path} has {fps:g} frames per second; valid: {FRAME_RATES[0]:g} to {FRAME_RATES[1]:g}")
    found = find_joints(path, names)
    joints = {joint: positions[:, [names.index(name) for name in pair]] for joint, pair in found.items()}
    used = {name for pair in found.values() for name in pair}
    clip = BodyClip(path.stem, fps, _upright(path, joints), tuple(name for name in names if name not in used))
    for chain in (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist")):
        if clip.length(*chain) < _SHORTEST:
            raise MotionFileError(
                f"{path}: {' to '.join(chain)} has no length; give a skeleton with offsets of its joints"
            )
    return clip


def find_joints(path: pathlib.Path, names: list[str]) -> dict[str, tuple[str, str]]:
    """Return the file's names of the left and the right of `JOINTS`, with or without a prefix such as `mixamorig:`."""
    plain = {_plain(name): name for name in reversed(names)}
    found, missing = {}, []
    for joint, patterns in _NAMES.items():
        pair = []
        for side, words in _SIDES.items():
            options = [pattern.format(word) for word in words for pattern in patterns]
            name = next((plain[option] for option in options if option in plain), None)
            pair.append(name)
            if name is None:
                missing.append(f"{side} {joint} (such as {_usual(joint, side)})")
        found[joint] = tuple(pair)
    if missing:
        raise MotionFileError(
            f"{path} lacks joints that a whole-body motion needs: {', '.join(missing)}; "
            "rename the joints of the skeleton"
        )
    return found


def _usual(joint: str, side: str) -> str:
    word = {"hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand"}[
        joint
    ]
    return f"{side.capitalize()}{word}"


def _plain(name: str) -> str:
    """Return a joint's name without the skeleton's prefix, in lower case letters only."""
    name = re.split(r"[:|]", name)[-1].lower().removeprefix("mixamorig").removeprefix("bip01").removeprefix("bip001")
    return re.sub(r"[^a-z]", "", name)


def _upright(path: pathlib.Path, joints: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the joints in axes with z up."""
    upwards = (joints["shoulder"] - joints["ankle"]).mean(axis=(0, 1))
    axis = int(np.argmax(np.abs(upwards)))
    turn = _TO_Z_UP[axis]
    if upwards[axis] == 0.0:
        raise MotionFileError(f"{path}: the shoulders are not above the feet along any axis; give a person who stands")
    if upwards[axis] < 0.0:
        turn = _HALF_TURN @ turn
    return {joint: positions @ turn.T for joint, positions in joints.items()}
