"""Arm motions: files of joint positions over time, resampling, the paper's noise range, and a seeded generator.

A motion file is an .npz without pickled objects, with `fps` (frames per second), `joint_names` (strings) and
`positions` (frames x joints, radians). It holds all eight arm joints, in any order and among any others.
"""

import dataclasses
import io
import pathlib
import zipfile
import zlib

import numpy as np

from hugwbc.blends import minimum_jerk
from hugwbc.errors import MotionFileError
from hugwbc.files import write_whole
from hugwbc.robot import load_robot

MOTION_FPS = 50.0  # [Hz], the learned controller's rate; motions are resampled to it
FRAME_RATES = (0.1, 1e4)  # [Hz], of motions in files; what is far from any camera's is a mistake
_FIELDS = ("fps", "joint_names", "positions")
# What NumPy and zipfile raise on truncated, corrupted or encrypted archives.
_UNREADABLE = (
    OSError, EOFError, KeyError, ValueError, MemoryError, NotImplementedError, RuntimeError,
    zipfile.BadZipFile, zlib.error,
)  # fmt: skip
# Uniform arm targets of the intervention noise [rad] of the left arm; the right arm's are their mirror image (the
# authors' ranges).
_LEFT_NOISE = {
    "shoulder_pitch": (-2.6, 2.6),
    "shoulder_roll": (-0.3, 3.0),
    "shoulder_yaw": (-1.2, 4.3),
    "elbow": (-1.2, 2.5),
}
_MIRRORED = ("shoulder_roll", "shoulder_yaw")
_REACH = 0.6  # of generated motions, as a fraction of the noise range around nominal
_SEGMENT = (0.4, 1.6)  # [s], from one posture of a generated motion to the next


def arm_noise_range() -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper arm targets of the intervention noise, order of `Robot.arm_names` [rad], each of shape (8,)."""
    bounds = []
    for name in load_robot().arm_names:
        side, part = name.removesuffix("_joint").split("_", 1)
        low, high = _LEFT_NOISE[part]
        bounds.append((-high, -low) if side == "right" and part in _MIRRORED else (low, high))
    low, high = np.array(bounds).T
    return low, high


@dataclasses.dataclass(frozen=True, eq=False)
class ArmMotion:
    """Joint positions of both arms over time.

    Attributes:
        name: of the motion, such as its file's.
        fps: frames per second.
        positions: order of `Robot.arm_names` [rad], shape (frames, 8).
    """

    name: str
    fps: float
    positions: np.ndarray

    @property
    def duration(self) -> float:
        """From the first to the last frame [s]."""
        return (len(self.positions) - 1) / self.fps

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities at time `t` [s], by linear interpolation [rad], [rad/s], each of shape (8,).

        Before its start and after its end a motion rests.
        """
        frame = t * self.fps
        if not 0.0 <= frame < len(self.positions) - 1:
            return self.positions[0 if frame < 0.0 else -1].copy(), np.zeros(self.positions.shape[1])
        before, after = self.positions[int(frame)], self.positions[int(frame) + 1]
        return before + (frame - int(frame)) * (after - before), self.fps * (after - before)

    def resampled(self, fps: float = MOTION_FPS) -> "ArmMotion":
        """The motion at another rate, by linear interpolation; what is left of the last interval is dropped."""
        frames = int(np.floor(self.duration * fps + 1e-9)) + 1
        index = np.arange(frames) / fps * self.fps
        columns = [np.interp(index, np.arange(len(self.positions)), column) for column in self.positions.T]
        return ArmMotion(self.name, fps, np.stack(columns, axis=1))

    def save(self, path: pathlib.Path) -> None:
        """Write a motion file, whose name should end in .npz; its folder is made."""
        content = io.BytesIO()
        names = np.array(load_robot().arm_names)
        np.savez(content, fps=np.array(self.fps), joint_names=names, positions=self.positions)
        write_whole(path, content.getvalue())


def load_motion(path: pathlib.Path) -> ArmMotion:
    """Read a motion file; positions outside the joint limits are clamped to them.

    Raises:
        MotionFileError: if the file cannot be read, lacks a field or an arm joint, or holds what is no motion.
    """
    arrays = read_arrays(path)
    absent = [field for field in _FIELDS if field not in arrays]
    if absent:
        raise MotionFileError(f"{path} lacks {', '.join(absent)}; a motion file is an .npz with {', '.join(_FIELDS)}")
    fps, names, positions = (arrays[field] for field in _FIELDS)
    robot = load_robot()
    found = unique_names(path, names)
    missing = [name for name in robot.arm_names if name not in found]
    if missing:
        raise MotionFileError(f"{path} lacks the joints {', '.join(missing)}; it must hold all of {robot.arm_names}")
    if positions.ndim != 2 or not is_real(positions) or positions.shape[0] < 2 or positions.shape[1] != len(found):
        raise MotionFileError(
            f"{path} has positions of shape {positions.shape}, {positions.dtype}; valid: at least 2 frames of "
            f"{len(found)} joint angles, one for each joint name"
        )
    if not is_frame_rate(fps):
        raise MotionFileError(f"{path} has fps = {fps}; give one number from {FRAME_RATES[0]:g} to {FRAME_RATES[1]:g}")
    if not np.all(np.isfinite(positions)):
        raise MotionFileError(f"{path} has positions that are not finite; repair or cut the motion")
    arms = positions[:, [found.index(name) for name in robot.arm_names]].astype(float)
    arms = np.clip(arms, robot.lower[robot.arms], robot.upper[robot.arms])
    return ArmMotion(pathlib.Path(path).stem, float(fps.item()), arms)


def is_real(array: np.ndarray) -> bool:
    """Whether an array holds real numbers: neither text nor complex ones."""
    return array.dtype.kind in "fiu"


def is_frame_rate(value: np.ndarray) -> bool:
    """Whether an array holds one number within `FRAME_RATES`."""
    return value.size == 1 and is_real(value) and FRAME_RATES[0] <= value.item() <= FRAME_RATES[1]


def read_arrays(path: pathlib.Path) -> dict[str, np.ndarray]:
    """All arrays of an .npz file by name.

    Raises:
        MotionFileError: if it cannot be read, is no .npz, or holds pickled objects.
    """
    try:
        with pathlib.Path(path).open("rb") as stream:
            # NumPy takes what is no archive for a pickle, and advises to allow that.
            if not zipfile.is_zipfile(stream):
                raise MotionFileError(f"cannot read {path}: it is no .npz archive")
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except _UNREADABLE as error:
        raise MotionFileError(f"cannot read {path}: {error}; give an .npz file without pickled objects") from error


def unique_names(path: pathlib.Path, names: np.ndarray) -> list[str]:
    """Joint names as text.

    Raises:
        MotionFileError: if one is there twice.
    """
    found = [str(name) for name in np.ravel(names)]
    twice = [name for name in dict.fromkeys(found) if found.count(name) > 1]
    if twice:
        raise MotionFileError(f"{path} names the joints {', '.join(twice)} more than once; keep one column of each")
    return found


def load_motions(folder: pathlib.Path) -> list[ArmMotion]:
    """All motion files of a folder, in the order of their names.

    Raises:
        MotionFileError: if there is none, or one cannot be used.
    """
    paths = sorted(pathlib.Path(folder).glob("*.npz"))
    if not paths:
        raise MotionFileError(f"{folder} holds no motion files; give a folder with .npz files")
    return [load_motion(path) for path in paths]


def generate_motions(seed: int, count: int = 20, duration: float = 20.0) -> list[ArmMotion]:
    """Arm motions that need no recording: minimum-jerk movements between random postures, at `MOTION_FPS`.

    Every movement takes 0.4 to 1.6 s. Postures are uniform over the middle 60 % of the noise range, around nominal.

    Args:
        seed: of the postures and times.
        count: number of motions.
        duration: of each [s].
    """
    rng = np.random.default_rng(seed)
    return [ArmMotion(f"generated-{index}", MOTION_FPS, _generate(rng, duration)) for index in range(count)]


def _generate(rng: np.random.Generator, duration: float) -> np.ndarray:
    robot = load_robot()
    nominal = robot.nominal[robot.arms]
    low, high = (nominal + _REACH * (bound - nominal) for bound in arm_noise_range())
    frames = round(duration * MOTION_FPS) + 1
    pieces, posture, total = [nominal[None]], nominal, 1
    while total < frames:
        steps = round(rng.uniform(*_SEGMENT) * MOTION_FPS)
        target = rng.uniform(low, high)
        u = np.arange(1, steps + 1)[:, None] / steps
        pieces.append(posture + minimum_jerk(u, target - posture))
        posture, total = target, total + steps
    return np.concatenate(pieces)[:frames]
