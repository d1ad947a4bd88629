"""Arm motions: files of joint positions over time, resampling, the paper's noise range, and a seeded generator.

A motion file is an .npz without pickled objects, with `fps` (frames per second), `joint_names` (strings) and
`positions` (frames x joints, radians). It holds all arm joints of a robot, in any order and among any others.
Or it is a .csv, whose first line names the columns: `t` [s], which rises in equal steps, and the joints [rad].
"""

import collections
import dataclasses
import io
import logging
import pathlib
import tokenize
import zipfile
import zlib
from collections.abc import Sequence

import numpy as np

from hugwbc.errors import ConfigError
from hugwbc.files import write_whole
from hugwbc.numeric import minimum_jerk
from hugwbc.robot import Robot, load_mirror
from hugwbc.scripts.sampled import check_pace, check_times, read_table, resampled

_log = logging.getLogger(__name__)

MOTION_FPS = 50.0  # [Hz]; motions are resampled to this rate, which is the learned controller's
FRAME_RATES = (0.1, 1e4)  # [Hz], the valid range in files; rates far from any camera's are mistakes
_FIELDS = ("fps", "joint_names", "positions")
_READABLE = (".npz", ".csv")
LARGEST_MOTION = 50_000_000  # [byte] unpacked, 1.8 hours of 19 joints at 50 Hz in double precision
_LISTED = 20  # names in one message
_TIME = "t"  # the column of a .csv
_UNEVEN = 0.02  # share of a step by which the times of a .csv may differ from equal steps, being rounded
_PACE, _JUMP = (0.02, 25.0), 0.5  # [rad/s], [rad]; an H1's arms reach 20 rad/s
_ROUNDED = 1e-3  # [rad], rounding in files
_BEYOND = (0.1, 0.1)  # [rad] past a joint limit, and the share of frames there from which a motion is refused
# What NumPy and zipfile raise on truncated, corrupted or encrypted archives.
UNREADABLE = (
    OSError, EOFError, KeyError, ValueError, OverflowError, MemoryError, NotImplementedError, RuntimeError,
    SyntaxError, tokenize.TokenError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
# Ranges of the uniform intervention noise for the left arm [rad], as the paper's authors have them for the H1, and the
# axes about which its joints turn; those of the right arm are their mirror image.
_LEFT_NOISE = {
    "shoulder_pitch": ("y", (-2.6, 2.6)),
    "shoulder_roll": ("x", (-0.3, 3.0)),
    "shoulder_yaw": ("z", (-1.2, 4.3)),
    "elbow": ("y", (-1.2, 2.5)),
}
_REACH = 0.6  # range of generated motions around nominal, as a fraction of the noise range
_SEGMENT = (0.4, 1.6)  # [s], time from one posture of a generated motion to the next


def arm_noise_range(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper bounds of the intervention noise, order of `Robot.arm_names` [rad], shape (arms,).

    They are the authors' bounds, cut to the robot's joint limits; these limits alone bound joints that the authors'
    robot lacks. For a joint that turns the other way, the bounds are negated and swapped.
    """
    bounds = np.stack((robot.lower, robot.upper))
    for part, (axis, ends) in _LEFT_NOISE.items():
        left = robot.pair(part)[0]
        turned = robot.axes[left, "xyz".index(axis)] < 0.0
        bounds[:, left] = np.clip([-ends[1], -ends[0]] if turned else ends, *bounds[:, left])
    low, high = bounds[:, robot.arms]
    images = np.sort(load_mirror(robot).arms(np.stack((low, high)), robot), axis=0)
    half = len(low) // 2
    return np.r_[low[:half], images[0, half:]], np.r_[high[:half], images[1, half:]]


@dataclasses.dataclass(frozen=True, eq=False)
class ArmMotion:
    """Joint positions of both arms over time.

    Attributes:
        name: name of the motion, such as that of its file.
        fps: frames per second.
        positions: joint positions in the order of `Robot.arm_names` [rad], shape (frames, arm joints).
        robot: the robot whose arms they are.
        unused: joints in the file that are not of the arms, such as the legs; a motion does not move them.
    """

    name: str
    fps: float
    positions: np.ndarray
    robot: Robot
    unused: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """Time from the first to the last frame [s]."""
        return (len(self.positions) - 1) / self.fps

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return positions [rad] and velocities [rad/s] of the arm joints at time `t` [s], by linear interpolation.

        The motion rests before its start and after its end.
        """
        frame = t * self.fps
        if not 0.0 <= frame < len(self.positions) - 1:
            return self.positions[0 if frame < 0.0 else -1].copy(), np.zeros(self.positions.shape[1])
        before, after = self.positions[int(frame)], self.positions[int(frame) + 1]
        return before + (frame - int(frame)) * (after - before), self.fps * (after - before)

    def resampled(self, fps: float = MOTION_FPS) -> "ArmMotion":
        """Return the motion at another rate by linear interpolation; an incomplete last interval is dropped."""
        return dataclasses.replace(self, fps=fps, positions=resampled(self.positions, self.fps, fps))

    def save(self, path: str | pathlib.Path) -> None:
        """Write a motion file, whose name should end in .npz; its folder is created."""
        content = io.BytesIO()
        names = np.array(self.robot.arm_names)
        np.savez(content, fps=np.array(self.fps), joint_names=names, positions=self.positions)
        write_whole(pathlib.Path(path), content.getvalue())


def load_motion(path: str | pathlib.Path, robot: Robot) -> ArmMotion:
    """Read a motion file for a robot; positions outside the joint limits are clamped, which is logged as a warning.

    A warning also names the joints that are not of the arms: the robot's legs and waist do not follow a motion.
    """
    motion, warning = _read_motion(path, robot)
    if motion.unused:
        _log.warning("%s: only the arms follow a motion; not used: %s", path, _listed(motion.unused))
    if warning:
        _log.warning("%s", warning)
    return motion


def check_motion(what: str, motion: ArmMotion) -> str:
    """Refuse a motion in other units, with jumps, or far beyond joint limits; return a warning of less, "" for none.

    Args:
        what: the subject of messages, such as the file.
        motion: the motion, not clamped.
    """
    fps, positions, robot = motion.fps, np.asarray(motion.positions), motion.robot
    if not FRAME_RATES[0] <= fps <= FRAME_RATES[1]:
        raise ConfigError(f"{what} has fps = {fps}; give one number from {FRAME_RATES[0]:g} to {FRAME_RATES[1]:g}")
    if positions.shape != (max(1, len(positions)), len(robot.arm_names)) or not np.all(np.isfinite(positions)):
        raise ConfigError(
            f"{what} has positions that are not finite, or not one frame or more of {len(robot.arm_names)} arm "
            f"joints, but of shape {positions.shape}; repair or cut the motion"
        )
    if (largest := np.abs(positions).max()) > 2.0 * np.pi:
        raise ConfigError(
            f"{what} has angles up to {largest:.1f}, more than a full turn in radians; if they are degrees, convert "
            "them with np.deg2rad, otherwise unwrap them"
        )
    moved = np.abs(np.diff(positions, axis=0)).max(axis=1)
    check_pace(what, np.arange(len(positions)) / fps, moved, "rad", _PACE, _JUMP)
    past = np.maximum(robot.lower[robot.arms] - positions, positions - robot.upper[robot.arms])
    worst = past.max(axis=1)
    if worst.max() <= _ROUNDED:
        return ""
    warning = (
        f"{what}: {np.mean(worst > _ROUNDED):.1%} of the frames are beyond joint limits, by up to {worst.max():.2f} "
    )
    warning += f"rad ({robot.arm_names[past.max(axis=0).argmax()]})"
    if np.mean(worst > _BEYOND[0]) > _BEYOND[1]:
        raise ConfigError(
            f"{warning}; give radians that the arms can reach, with the signs and zeros of the {robot.name}"
        )
    return f"{warning}; they are clamped"


def _read_motion(path: str | pathlib.Path, robot: Robot) -> tuple[ArmMotion, str]:
    """Return a clamped motion, and what `check_motion` says of it."""
    path = pathlib.Path(path)
    if path.suffix.lower() not in _READABLE:
        valid = f"valid for arms: {' and '.join(_READABLE)}, for the whole body with play --motion: .bvh; convert it"
        raise ConfigError(f"cannot read {path}: '{path.suffix}' is not a motion file type; {valid}")
    arrays = _read_csv(path) if path.suffix.lower() == ".csv" else read_arrays(path)
    absent = [field for field in _FIELDS if field not in arrays]
    if absent:
        raise ConfigError(f"{path} lacks {', '.join(absent)}; a motion file is an .npz with {', '.join(_FIELDS)}")
    fps, names, positions = (arrays[field] for field in _FIELDS)
    found = unique_names(path, names)
    missing = [name for name in robot.arm_names if name not in found]
    if missing:
        raise ConfigError(f"{path} lacks the joints {', '.join(missing)}; it must hold all of {robot.arm_names}")
    if positions.ndim != 2 or not is_real(positions) or positions.shape[0] < 2 or positions.shape[1] != len(found):
        raise ConfigError(
            f"{path} has positions of shape {positions.shape}, {positions.dtype}; valid: at least 2 frames of "
            f"{len(found)} joint angles, one for each joint name"
        )
    if fps.size != 1 or not is_real(fps):
        raise ConfigError(f"{path} has fps = {fps}; give one number from {FRAME_RATES[0]:g} to {FRAME_RATES[1]:g}")
    arms = positions[:, [found.index(name) for name in robot.arm_names]].astype(float)
    unused = tuple(name for name in found if name not in robot.arm_names)
    motion = ArmMotion(path.stem, float(fps.item()), arms, robot, unused)
    warning = check_motion(str(path), motion)
    arms = np.clip(arms, robot.lower[robot.arms], robot.upper[robot.arms])
    return dataclasses.replace(motion, positions=arms), warning


def _read_csv(path: pathlib.Path) -> dict[str, np.ndarray]:
    """Return the fields of a motion from a table."""
    names, table = read_table(path, f"{_TIME} [s] and one per joint [rad]")
    if _TIME not in names:
        raise ConfigError(f"{path}:1: no column is named {_TIME}; the first line names {_TIME} [s] and the joints")
    if len(table) < 2:
        raise ConfigError(f"{path} has {len(table)} frames; a motion needs at least 2")
    column = names.index(_TIME)
    check_times(str(path), table[:, column])
    steps = np.diff(table[:, column])
    mean = float(steps.mean())
    if not np.all(np.abs(steps - mean) <= _UNEVEN * mean):
        raise ConfigError(f"{path}: the times do not rise in equal steps; resample the motion")
    if not FRAME_RATES[0] <= 1.0 / mean <= FRAME_RATES[1]:
        shortest, longest = 1.0 / FRAME_RATES[1], 1.0 / FRAME_RATES[0]
        raise ConfigError(
            f"{path} has {mean:g} s between its times; give {_TIME} in seconds (divide milliseconds by 1000), "
            f"{shortest:g} to {longest:g} s apart"
        )
    joints = np.array([name for name in names if name != _TIME])
    return {"fps": np.array(1.0 / mean), "joint_names": joints, "positions": np.delete(table, column, axis=1)}


def is_real(array: np.ndarray) -> bool:
    """Return whether an array holds real numbers, neither text nor complex ones."""
    return array.dtype.kind in "fiu"


def read_arrays(path: pathlib.Path) -> dict[str, np.ndarray]:
    """Read all arrays of an .npz file by name."""
    try:
        with pathlib.Path(path).open("rb") as stream:
            # NumPy takes any other file for a pickle and advises to allow pickles.
            if not zipfile.is_zipfile(stream):
                raise ConfigError(f"cannot read {path}: it is not an .npz archive")
            with zipfile.ZipFile(stream) as archive:
                size = sum(member.file_size for member in archive.infolist())
                others = [name for name in archive.namelist() if not name.endswith(".npy")]
        if size > LARGEST_MOTION:
            raise ConfigError(f"{path} unpacks to {size} bytes; valid: up to {LARGEST_MOTION}. Cut the motion")
        if others:
            raise ConfigError(f"cannot read {path}: {others[0]!r} is not a NumPy array; write it with np.savez")
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except UNREADABLE as error:
        raise ConfigError(f"cannot read {path}: {error}; give an .npz file without pickled objects") from error


def unique_names(path: pathlib.Path, names: np.ndarray) -> list[str]:
    """Return joint names as text."""
    found = [name.decode(errors="replace") if isinstance(name, bytes) else str(name) for name in np.ravel(names)]
    twice = [name for name, count in collections.Counter(found).items() if count > 1]
    if twice:
        raise ConfigError(f"{path} names the joints {_listed(twice)} more than once; keep one column of each")
    return found


def _listed(names: Sequence[str]) -> str:
    """Return the first names and how many follow."""
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more


def motion_files(folder: str | pathlib.Path) -> list[pathlib.Path]:
    """Return the motion files of a folder, ordered by name."""
    return sorted(path for path in pathlib.Path(folder).glob("*") if path.suffix.lower() in _READABLE)


def load_motions(folder: str | pathlib.Path, robot: Robot) -> list[ArmMotion]:
    """Read all motion files of a folder, ordered by name; what is not used or clamped is logged as by `load_motion`."""
    paths = motion_files(folder)
    if not paths:
        raise ConfigError(f"{folder} holds no motion files; give a folder with {' or '.join(_READABLE)} files")
    read = [_read_motion(path, robot) for path in paths]
    motions, clamped = [motion for motion, _ in read], [warning for _, warning in read if warning]
    unused = list(dict.fromkeys(name for motion in motions for name in motion.unused))
    if unused:  # one line, not one for each of perhaps a thousand files
        _log.warning("%s: only the arms follow a motion; not used: %s", folder, _listed(unused))
    if clamped:
        _log.warning("%d of %d motions are beyond joint limits; the first: %s", len(clamped), len(read), clamped[0])
    return motions


def generate_motions(robot: Robot, seed: int, count: int = 20, duration: float = 20.0) -> list[ArmMotion]:
    """Generate arm motions without recordings: minimum-jerk movements between random postures, at `MOTION_FPS`.

    Each movement takes 0.4 to 1.6 s. Postures are uniform over the noise range, shrunk to 60 % about the nominal one.

    Args:
        robot: whose arms move.
        seed: seed of the postures and times.
        count: number of motions.
        duration: length of each motion [s].
    """
    rng = np.random.default_rng(seed)
    clips = [_generate(robot, rng, duration) for _ in range(count)]
    return [ArmMotion(f"generated-{index}", MOTION_FPS, clip, robot) for index, clip in enumerate(clips)]


def _generate(robot: Robot, rng: np.random.Generator, duration: float) -> np.ndarray:
    nominal = robot.nominal[robot.arms]
    low, high = (nominal + _REACH * (bound - nominal) for bound in arm_noise_range(robot))
    frames = round(duration * MOTION_FPS) + 1
    pieces, posture, total = [nominal[None]], nominal, 1
    while total < frames:
        steps = round(rng.uniform(*_SEGMENT) * MOTION_FPS)
        target = rng.uniform(low, high)
        u = np.arange(1, steps + 1)[:, None] / steps
        pieces.append(posture + minimum_jerk(u, target - posture))
        posture, total = target, total + steps
    return np.concatenate(pieces)[:frames]
