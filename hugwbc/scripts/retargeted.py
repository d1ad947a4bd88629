"""Retargeted arm motions of other projects: other field names and joint names, missing joints, unequal lengths.

Motion sets such as AMASS may not be redistributed. To use one that is retargeted to the H1, read it with
`load_retargeted` and write motion files (see `hugwbc.scripts.motion`) with `ArmMotion.save`.
"""

import dataclasses
import pathlib
from collections.abc import Mapping

import numpy as np

from hugwbc.errors import MotionFileError
from hugwbc.robot import load_robot
from hugwbc.scripts.motion import FRAME_RATES, ArmMotion, is_frame_rate, is_real, read_arrays, unique_names

_FPS = ("fps", "mocap_framerate", "mocap_frame_rate", "framerate")
_NAMES = ("joint_names", "dof_names")
_POSITIONS = ("positions", "joint_pos", "dof_pos", "dof")
LARGEST_ANGLE = 2.0 * np.pi  # [rad]; no joint of the robot can turn that far


@dataclasses.dataclass(frozen=True, eq=False)
class Retargeted:
    """A motion, and how the file had to be changed.

    Attributes:
        motion: motion of the eight arm joints.
        missing: arm joints that the file lacks; they stay at their nominal positions.
        unused: the file's names of what is not an arm joint, such as the legs; it is left out.
        dropped_frames: number of frames at the end that some joints lack.
        clamped: share of the angles that lay outside the joint limits.
    """

    motion: ArmMotion
    missing: tuple[str, ...]
    unused: tuple[str, ...]
    dropped_frames: int
    clamped: float


def load_retargeted(path: pathlib.Path, mapping: Mapping[str, str] | None = None) -> Retargeted:
    """Read an .npz with one array of all joints and their names, or with one array per joint.

    Args:
        path: path of the file; pickled objects in it are refused.
        mapping: the robot's name for each of the file's joint names that differs in more than case and the endings
            `_joint` and `_link`.

    Raises:
        MotionFileError: if the file cannot be read, lacks a frame rate or all arm joints, or holds angles that are not
            finite or are in degrees.
        UnknownNameError: if the mapping names a joint that the robot does not have.
    """
    fields = read_arrays(path)
    rate = next((fields[name] for name in _FPS if name in fields), None)
    if rate is None or not is_frame_rate(rate):
        raise MotionFileError(
            f"{path} has no frame rate; give one number from {FRAME_RATES[0]:g} to {FRAME_RATES[1]:g} Hz as "
            f"{' or '.join(_FPS)}"
        )
    robot = load_robot()
    for name in (mapping or {}).values():
        robot.index(name)
    given = {_plain(old): new for old, new in (mapping or {}).items()}
    known = {_plain(name): name for name in robot.arm_names}
    columns, unused = {}, []
    for name, column in _columns(path, fields).items():
        target = given.get(_plain(name), known.get(_plain(name)))
        if target in robot.arm_names:
            columns[target] = np.asarray(column, dtype=float)
        else:
            unused.append(name)
    if not columns:
        raise MotionFileError(
            f"{path} has none of the joints {', '.join(robot.arm_names)}; give a mapping of the names"
        )
    return _assemble(path, float(rate.item()), columns, tuple(unused))


def _plain(name: str) -> str:
    return name.lower().removesuffix("_joint").removesuffix("_link")


def _columns(path: pathlib.Path, fields: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the angles of every joint in the file, by name."""
    names = next((fields[name] for name in _NAMES if name in fields), None)
    positions = next((fields[name] for name in _POSITIONS if name in fields), None)
    if names is None or positions is None:
        return {name: array for name, array in fields.items() if array.ndim == 1 and is_real(array)}
    found = unique_names(path, names)
    if positions.ndim != 2 or positions.shape[1] != len(found) or not is_real(positions):
        raise MotionFileError(
            f"{path} has positions of shape {positions.shape} for {len(found)} joint names; give frames x joints"
        )
    return dict(zip(found, positions.T, strict=True))


def _assemble(path: pathlib.Path, fps: float, columns: Mapping[str, np.ndarray], unused: tuple[str, ...]) -> Retargeted:
    robot = load_robot()
    lengths = [len(column) for column in columns.values()]
    frames = min(lengths)
    if frames < 2:
        raise MotionFileError(f"{path} has a joint with {frames} frames; a motion needs at least 2")
    positions = np.tile(robot.nominal[robot.arms], (frames, 1))
    for index, name in enumerate(robot.arm_names):
        if name in columns:
            positions[:, index] = columns[name][:frames]
    if not np.all(np.isfinite(positions)):
        raise MotionFileError(f"{path} holds angles that are not finite; repair or cut the motion")
    largest = float(np.abs(positions).max())
    if largest > LARGEST_ANGLE:
        raise MotionFileError(f"{path} holds an angle of {largest:.0f}: these are degrees; convert them to radians")
    inside = np.clip(positions, robot.lower[robot.arms], robot.upper[robot.arms])
    return Retargeted(
        ArmMotion(path.stem, fps, inside),
        missing=tuple(name for name in robot.arm_names if name not in columns),
        unused=unused,
        dropped_frames=max(lengths) - frames,
        clamped=float(np.mean(inside != positions)),
    )
