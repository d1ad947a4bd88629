"""BVH clips of a person: the positions of the joints that a whole-body motion needs, in our axes.

The file is read by pybvh (extra `[motion]`). Units stay those of the file, often centimetres: whoever uses the clip
scales it by the lengths of legs and arms.
"""

import dataclasses
import itertools
import logging
import math
import pathlib
import re
import warnings

import numpy as np

from hugwbc.errors import ConfigError, needing
from hugwbc.robot import SIDES

_log = logging.getLogger(__name__)

# The joints of a limb, the words of their names in all conventions, and the usual names.
_LIMBS = {
    "leg": (("hip", "knee", "ankle"), "leg|hip|thigh|femur|knee|shin|calf|tibia|ankle|foot", "UpLeg, Leg, Foot"),
    "arm": (("shoulder", "elbow", "wrist"), "arm|should|shldr|humerus|elbow|radius|wrist|hand", "Arm, ForeArm, Hand"),
}
# Words of one joint only; "shoulder" may also say the collar bone, "leg" and "arm" several joints.
_OWN = {
    "hip": "up(per)?leg|hip|thigh|femur", "knee": "low(er)?leg|knee|shin|calf|tibia", "ankle": "ankle|foot|toe",
    "shoulder": "up(per)?arm|shldr|humerus", "elbow": "forearm|low(er)?arm|elbow|radius", "wrist": "wrist|hand",
    "collar": "collar|clav",
}  # fmt: skip
_WORDS = "|".join((*(words for _, words, _ in _LIMBS.values()), "toe", _OWN["collar"]))
_HELPER = re.compile("twist|roll(?!er)|helper", re.IGNORECASE)  # joints within a segment
_NEXT = 0.75  # longest collar bone or foot, as a part of the limb's segment next to it
JOINTS = tuple(joint for joints, _, _ in _LIMBS.values() for joint in joints)
_RATES = (5.0, 1000.0)  # [Hz] of cameras
# Cyclic permutations and a half turn, which bring one signed axis of the file to z; they are rotations, so that left
# stays left.
_TO_Z_UP = (
    np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    np.eye(3),
)
_HALF_TURN = np.diag([1.0, -1.0, -1.0])


@dataclasses.dataclass(frozen=True, eq=False)
class BodyClip:
    """Positions of a person's joints over time; x and y level, z up, left and right as the person's."""

    name: str  # name of the clip, such as that of its file
    fps: float  # frames per second
    # positions of the left and the right joint by name (`JOINTS`), in the units of the file, shape (frames, 2, 3) each
    joints: dict[str, np.ndarray]
    unused: tuple[str, ...] = ()  # joints of the file that are not read

    def length(self, *joints: str) -> float:
        """Return the length of a chain of joints, the median over both sides and time, in the units of the file."""
        pairs = itertools.pairwise(joints)
        return float(np.median(sum(np.linalg.norm(self.joints[b] - self.joints[a], axis=-1) for a, b in pairs)))


def load_bvh(path: str | pathlib.Path) -> BodyClip:
    """Read a BVH file of a person.

    The axis that points up is the one along which the rest pose stands; y, as most files have it, if it does not stand.
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
    except (OSError, ValueError, IndexError, KeyError, TypeError, ArithmeticError) as error:
        words = str(error).replace("\n", " ")
        raise ConfigError(
            f"cannot read {path}: {words}; give a BVH file with positions of the root and rotations of every joint"
        ) from error
    if len(positions) < 2 or not np.all(np.isfinite(positions)):
        raise ConfigError(f"{path} holds fewer than 2 frames or numbers that are not finite; repair the motion")
    if not _RATES[0] <= fps <= _RATES[1]:
        raise ConfigError(
            f"{path} has {fps:.3g} frames per second; valid: {_RATES[0]:g} to {_RATES[1]:g}. The frame time is in "
            f"seconds: divide {1.0 / fps if fps else math.inf:g} by 1000 if it is in milliseconds"
        )
    if 0.0 < np.rad2deg(np.abs(read.joint_angles).max()) <= np.pi:
        _log.warning("%s: no angle is above 3.14; if these are radians, convert them to degrees", path)
    found = find_joints(path, names, dict(read.edges), positions)
    rest = read.rest_pose_positions()[[not node.is_end_site() for node in read.nodes]]
    turn = _to_z_up({joint: rest[list(pair)].mean(axis=0) for joint, pair in found.items()})
    joints = {joint: positions[:, list(pair)] @ turn.T for joint, pair in found.items()}
    used = {index for pair in found.values() for index in pair}
    return BodyClip(path.stem, fps, joints, tuple(name for index, name in enumerate(names) if index not in used))


def find_joints(
    path: pathlib.Path, names: list[str], parents: dict[int, int], positions: np.ndarray
) -> dict[str, tuple[int, int]]:
    """Return the indices of the left and the right of `JOINTS`.

    A limb is the longest two segments in a row whose joints have names of its side and kind. So a joint named foot
    counts as the ankle where toes follow it, and as the toes where an ankle comes before it. What is not clear raises a
    `ConfigError`.

    Args:
        path: for messages.
        names: of the joints.
        parents: the parent of each joint but the root, by index.
        positions: of the joints over time, shape (frames, joints, 3).
    """
    names = [re.split("[:|]", name)[-1] for name in names]  # without a prefix such as `mixamorig:`
    sides = [_side(name) for name in names]
    words = [re.sub("[^a-z]", "", name.lower()) for name in names]
    sided = [joint for joint, name in enumerate(names) if sides[joint] and not _HELPER.search(name)]
    up = {}  # the next joint of the same limb
    for joint in sided:
        parent = parents.get(joint)
        while parent in parents and _HELPER.search(names[parent]):
            parent = parents[parent]
        if parent in sided and sides[parent] == sides[joint]:
            up[joint] = parent

    def length(a: int, b: int) -> float:
        return float(np.median(np.linalg.norm(positions[:, a] - positions[:, b], axis=-1)))

    def limb(side: str, kind: str) -> tuple[int, int, int]:
        joints, known, usual = _LIMBS[kind]
        mine = [c for c in sided if sides[c] == side and re.search(known, words[c] + words[up.get(c, c)])]
        rows = [(up[up[c]], up[c], c) for c in mine if c in up and up[c] in up]
        total = {(a, b, c): length(a, b) + length(b, c) for a, b, c in rows}
        best = max(rows, key=lambda row: total[row], default=(0, 0, 0))
        a, b, c = best
        unclear = not total.get(best) or any(
            (total[row] > 0.95 * total[best] and max(map(length, row, best)) > 0.1 * length(b, c))
            or (row[1:] == (a, b) and length(row[0], a) > _NEXT * length(a, b))
            or (row[:2] == (b, c) and length(c, row[2]) > _NEXT * length(b, c))
            for row in rows
        )
        if unclear or any(
            role != joint and re.search(own, words[index])
            for joint, index in zip(joints, best, strict=True)
            for role, own in _OWN.items()
        ):
            raise ConfigError(
                f"{path}: the {side} {kind} ({', '.join(joints)}) is not clear from the joints "
                f"{', '.join(names[c] for c in mine) or 'of the file'}; name three in a row {side} {usual}, "
                "and those within a segment twist"
            )
        return best

    found = {}
    for kind, (joints, _, _) in _LIMBS.items():
        found |= zip(joints, zip(*(limb(side, kind) for side in SIDES), strict=True), strict=True)
    return found


def _side(name: str) -> str:
    """Return "left" or "right" if a joint's name says so, else an empty text."""
    parts = [part.lower() for part in re.findall("[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)]
    said = [s for s in SIDES if any(re.match(f"{s}|{s[0]}$|{s[0]}({_WORDS})", part) for part in parts)]
    return said[0] if len(said) == 1 else ""


def _to_z_up(rest: dict[str, np.ndarray]) -> np.ndarray:
    """Return the rotation from the file's axes to those with z up, shape (3, 3)."""
    trunk, legs = rest["shoulder"] - rest["hip"], rest["hip"] - rest["ankle"]
    stands = trunk @ legs > 0.5 * np.linalg.norm(trunk) * np.linalg.norm(legs)  # that of LAFAN1 is folded
    upwards = trunk + legs if stands else np.array([0.0, 1.0, 0.0])
    axis = int(np.argmax(np.abs(upwards)))
    return _TO_Z_UP[axis] if upwards[axis] > 0.0 else _HALF_TURN @ _TO_Z_UP[axis]
