"""Whole-body motions: a person's clip as hands, h, p, w and velocities, so that any controller can follow it.

Lengths are scaled to the robot's: those of the hands by the arm, heights and velocities by the leg. Roll of the trunk,
head, fingers and the steps themselves have no command, and are dropped: the controller makes its own steps.
"""

import dataclasses
import functools
import logging
import pathlib

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, uniform_filter1d

from hugwbc import rotations
from hugwbc.commands import MEASURED_NAMES, VELOCITY_NAMES, Command, command_ranges
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.kinematics import Kinematics
from hugwbc.numeric import smooth_step
from hugwbc.robot import Robot
from hugwbc.scripts.bvh import BodyClip, load_bvh
from hugwbc.scripts.motion import MOTION_FPS
from hugwbc.scripts.sampled import check_pace, resampled
from hugwbc.state import RobotState
from hugwbc.targets import HandTargets

_log = logging.getLogger(__name__)

_SMOOTH_VELOCITY = 0.25  # [s], standard deviation; the sway of single steps is no velocity command
_SMOOTH_POSE = 0.06  # [s], likewise for hands, h, p and w: the noise of the capture
_MOVING = (0.15, 0.3)  # [m/s, rad/s], planar speed and yaw rate of the robot above which it walks
_AROUND = 0.5  # [s] to walk before and after that, so that the gait does not flicker
_RAMP = 1.0  # [s] from the default command to the clip's first frame
_MOST_BENT = 0.95  # least height of a standing person's hips, as a share of the straight legs' length
_PACE, _JUMP = (0.02, 15.0), 0.3  # [leg lengths / s], [leg lengths]; sprinters run at 13
_LYING = np.deg2rad(75.0)  # lean of the trunk, more than in a bow
_LOW = 0.35  # [leg lengths] between the hips and the ground, less than in a squat
_LIFTED = 0.2  # [leg lengths] of the lower ankle above its height on the ground, more than at push-off
_ASIDE = 0.35  # [leg lengths] from the middle of the trunk to the feet, more than a foot's length
_MOST_BAD = 0.1  # a clip of which a larger share is off the feet is refused
_TOLD = 6  # spans in one message
_UNITS = {"h": ("cm", 100.0), "p": ("deg", np.rad2deg(1.0)), "w": ("deg", np.rad2deg(1.0)), "hands": ("cm", 100.0),
          "v_x": ("m/s", 1.0), "v_y": ("m/s", 1.0), "omega": ("rad/s", 1.0)}  # fmt: skip


@dataclasses.dataclass(frozen=True, eq=False)
class WholeBodyMotion:
    """A clip at `MOTION_FPS` as a command source; the robot stands before its start and holds its end."""

    name: str  # name of the clip
    asked: np.ndarray  # what the clip asks, columns `MEASURED_NAMES`, shape (frames, 6); units as in `Command`
    hands: np.ndarray  # where it asks the left and the right hand to be, in the heading frame [m], shape (frames, 2, 3)
    walking: np.ndarray  # whether the robot walks, shape (frames,), bool
    # `hands` as the pitch and waist angle within the command ranges have them [m], the same shape
    reachable: np.ndarray
    robot: Robot  # whose ranges the commands have
    unused: tuple[str, ...] = ()  # joints of the file that are dropped

    @property
    def duration(self) -> float:
        """Time from the first to the last frame [s]."""
        return (len(self.asked) - 1) / MOTION_FPS

    @functools.cached_property
    def allowed(self) -> np.ndarray:
        """What the command ranges allow of `asked`, the same shape."""
        return np.stack([self._clamped(frame) for frame in range(len(self.asked))])

    def _clamped(self, frame: int) -> np.ndarray:
        command, _ = Command.from_mapping(_named(self.asked[frame]), self._gait(frame), self.robot).clamp(self.robot)
        return np.array([getattr(command, name) for name in MEASURED_NAMES])

    def _gait(self, frame: int) -> Gait:
        return Gait.WALKING if self.walking[frame] else Gait.STANDING

    def frame_at(self, t: float) -> int:
        """Return the index of the frame at time `t` [s], the first or last one outside of the clip."""
        return int(np.clip(round(t * MOTION_FPS), 0, len(self.asked) - 1))

    def command_at(self, t: float) -> Command:
        """Return the command at time `t` [s], within the ranges of its gait; it starts from the default within 1 s."""
        frame = self.frame_at(t)
        values = _named(smooth_step(t / _RAMP) * self.allowed[frame])
        if 0.0 <= t <= self.duration:
            return Command.from_mapping(values, self._gait(frame), self.robot)
        posture = {name: value for name, value in values.items() if name not in VELOCITY_NAMES}
        return Command.from_mapping(posture, Gait.STANDING, self.robot)

    def hands_at(self, t: float) -> HandTargets:
        """Return the hand targets at time `t` [s], in the heading frame, by linear interpolation."""
        place = np.clip(t * MOTION_FPS, 0.0, len(self.reachable) - 1)
        before = min(int(place), len(self.reachable) - 2)
        low, high = self.reachable[before : before + 2]
        left, right = low + (place - before) * (high - low)
        return HandTargets(left, right, "heading")


def _named(values: np.ndarray) -> dict[str, float]:
    return dict(zip(MEASURED_NAMES, map(float, values), strict=True))


def load_whole_body_motion(path: str | pathlib.Path, robot: Robot) -> WholeBodyMotion:
    """Read a BVH file and retarget it to a robot."""
    return retarget(load_bvh(path), robot)


def retarget(clip: BodyClip, robot: Robot) -> WholeBodyMotion:
    """Return a person's clip as commands and hand targets of a robot.

    The height is that of the middle of the hips above the ankles, minus that of standing: the 95th percentile of the
    clip, but between 95 and 100 % of straight legs. Pitch is the lean of the line from hips to shoulders in the heading
    of the hips; the waist angle is the yaw from hips to shoulders. Hands are where the person's wrists are from their
    shoulders, put at the robot's shoulders.
    """
    straight = clip.length("hip", "knee", "ankle")
    moved = np.linalg.norm(np.diff(clip.joints["hip"].mean(axis=1), axis=0), axis=1) / straight
    check_pace(clip.name, np.arange(len(moved) + 1) / clip.fps, moved, "leg lengths", _PACE, _JUMP)
    joints = {name: resampled(points, clip.fps, MOTION_FPS) for name, points in clip.joints.items()}
    leg = robot.leg_length / straight
    arm = (robot.upper_arm + robot.forearm) / clip.length("shoulder", "elbow", "wrist")
    pelvis = joints["hip"].mean(axis=1)
    heading = np.unwrap(_yaw_of_pair(joints["hip"]))
    lowest = joints["ankle"][..., 2].min(axis=1)
    height = pelvis[:, 2] - np.percentile(lowest, 5)
    _check_stands(clip.name, {name: points / straight for name, points in joints.items()}, height / straight)
    standing = np.clip(np.percentile(height, 95), _MOST_BENT * straight, straight)
    back = np.stack([rotations.rotation_z(-float(yaw)) for yaw in heading])
    trunk = np.einsum("fij,fj->fi", back, joints["shoulder"].mean(axis=1) - pelvis)
    p = np.arctan2(trunk[:, 0], trunk[:, 2])
    w = rotations.wrap_angle(_yaw_of_pair(joints["shoulder"]) - heading)
    slow = _smooth(heading, _SMOOTH_VELOCITY)
    velocity = leg * np.gradient(_smooth(pelvis[:, :2], _SMOOTH_VELOCITY), 1.0 / MOTION_FPS, axis=0)
    v_x = np.cos(slow) * velocity[:, 0] + np.sin(slow) * velocity[:, 1]
    v_y = np.cos(slow) * velocity[:, 1] - np.sin(slow) * velocity[:, 0]
    omega = np.gradient(slow, 1.0 / MOTION_FPS)
    pose = _smooth(np.stack([leg * (height - standing), p, np.unwrap(w)], axis=1), _SMOOTH_POSE)
    asked = np.column_stack([v_x, v_y, omega, pose])
    reach = arm * np.einsum("fij,fsj->fsi", back, joints["wrist"] - joints["shoulder"])
    reach = _smooth(reach.reshape(len(reach), 6), _SMOOTH_POSE).reshape(reach.shape)
    moving = (np.hypot(v_x, v_y) > _MOVING[0]) | (np.abs(omega) > _MOVING[1])
    walking = maximum_filter1d(moving, 2 * int(_AROUND * MOTION_FPS) + 1, mode="constant")
    ranges = command_ranges(Gait.WALKING, robot)
    _, p, w = pose.T
    return WholeBodyMotion(
        clip.name,
        asked,
        reach + _shoulders(robot, p, w),
        walking,
        reach + _shoulders(robot, np.clip(p, *ranges["p"].finishing), np.clip(w, *ranges["w"].finishing)),
        robot,
        clip.unused,
    )


def _check_stands(name: str, joints: dict[str, np.ndarray], height: np.ndarray) -> None:
    """Log when the person is off the feet; refuse a clip in which that is more than `_MOST_BAD`.

    Args:
        name: of the clip.
        joints: as in `BodyClip`, at `MOTION_FPS`, in leg lengths.
        height: of the hips above the ground [leg lengths], shape (frames,).
    """
    pelvis, shoulders = joints["hip"].mean(axis=1), joints["shoulder"].mean(axis=1)
    lean = np.arctan2(np.linalg.norm((shoulders - pelvis)[:, :2], axis=1), (shoulders - pelvis)[:, 2])
    ankles = joints["ankle"][..., :2]
    feet = np.concatenate([ankles, ankles.mean(axis=1, keepdims=True)], axis=1)
    aside = np.linalg.norm(feet - (pelvis + shoulders)[:, None, :2] / 2.0, axis=-1).min(axis=1)
    lifted = height + joints["ankle"][..., 2].min(axis=1) - pelvis[:, 2]
    bad, told = np.zeros(len(lean), dtype=bool), []
    for what, wrong, longest in (
        ("lying or head down", lean > _LYING, 0.3),
        ("hips too low to stand", height < _LOW, 0.3),
        ("both feet off the ground", lifted > _LIFTED, 0.6),
        ("weight beside the feet, as on hands, knees or a seat", aside > _ASIDE, 0.5),
    ):
        for start, end in _runs(wrong):
            if end - start > min(longest * MOTION_FPS, 0.5 * len(lean)):
                bad[start:end] = True
                told.append(f"{what} from {start / MOTION_FPS:.1f} to {end / MOTION_FPS:.1f} s")
    if told:
        start, end = max(_runs(~bad), key=np.ptp, default=[0, 0])
        todo = f"cut the file to {start / MOTION_FPS:.1f} to {end / MOTION_FPS:.1f} s"
        if bad.all():
            todo = "give a clip of a person who stands; if this one does, turn the file so that its rest pose does, too"
        said = f"{name}: a robot on its feet cannot follow: {', '.join(told[:_TOLD])}; {todo}"
        if bad.mean() > _MOST_BAD:
            raise ConfigError(said)
        _log.warning("%s", said)


def _runs(mask: np.ndarray) -> list[list[int]]:
    """Return where runs of true values start and end."""
    return np.flatnonzero(np.diff(np.pad(mask.astype(int), 1))).reshape(-1, 2).tolist()


def _smooth(values: np.ndarray, deviation: float) -> np.ndarray:
    """Return columns after a Gaussian filter with a standard deviation in time [s]; the ends are held."""
    sigma = deviation * MOTION_FPS
    return gaussian_filter1d(values, sigma, axis=0, mode="nearest", radius=int(3.0 * sigma))


def _yaw_of_pair(pair: np.ndarray) -> np.ndarray:
    """Return the heading [rad] of a body whose left and right points are given, shape (frames,)."""
    leftwards = pair[:, 0] - pair[:, 1]
    return np.arctan2(-leftwards[:, 0], leftwards[:, 1])


def _shoulders(robot: Robot, p: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return the left and the right shoulder in the heading frame [m], shape (frames, 2, 3)."""
    sides = np.stack([robot.shoulder, robot.shoulder * (1.0, -1.0, 1.0)])
    turns = np.stack([rotations.rotation_zy(0.0, a) @ rotations.rotation_z(b) for a, b in zip(p, w, strict=True)])
    return np.einsum("fij,sj->fsi", turns, sides)


class MotionScore:
    """A record of how the robot followed a whole-body motion, for the error per part."""

    def __init__(self, motion: WholeBodyMotion, robot: Robot) -> None:
        """Watch a motion on a robot."""
        self.motion = motion
        self._kinematics = Kinematics(robot)
        self._done: list[tuple[int, np.ndarray, np.ndarray]] = []

    def watch(self, t: float, state: RobotState, hands: np.ndarray) -> None:
        """Take the true state and the positions of both hands in the world [m], shape (2, 3), at time `t` [s].

        One sample for each frame of the clip is kept.
        """
        frame = self.motion.frame_at(t)
        if self._done and self._done[-1][0] == frame:
            return
        self._kinematics.update(state)
        measured = self._kinematics.measured()
        level = (hands - state.position) @ rotations.rotation_z(state.yaw)
        values = np.array([getattr(measured, name) for name in MEASURED_NAMES])
        self._done.append((frame, values, level))

    def lines(self) -> list[str]:
        """Return a table of root mean square errors: what the ranges cut from the clip, and what the robot missed.

        The first second, in which the robot goes to the clip's first pose, counts for what is cut only. Errors of the
        robot's velocities are averaged over 1 s, because every step makes them sway.
        """
        motion = self.motion
        cut = _named(_rms(motion.asked - motion.allowed))
        cut["hands"] = float(_rms(np.linalg.norm(motion.hands - motion.reachable, axis=-1).ravel()))
        rows = [(frame, values, hands) for frame, values, hands in self._done if frame >= _RAMP * MOTION_FPS]
        missed = dict.fromkeys(cut, np.nan)
        if rows:
            frames = [frame for frame, _, _ in rows]
            off = np.stack([values for _, values, _ in rows]) - motion.asked[frames]
            off[:, :3] = uniform_filter1d(off[:, :3], min(len(off), int(MOTION_FPS)), axis=0, mode="nearest")
            missed |= _named(_rms(off))
            far = np.stack([hands for _, _, hands in rows]) - motion.hands[frames]
            missed["hands"] = float(_rms(np.linalg.norm(far, axis=-1).ravel()))
        lines = [f"{'part':8}{'cut by the ranges':>20}{'robot from the clip':>22}"]
        for name in ("hands", *MEASURED_NAMES[3:], *MEASURED_NAMES[:3]):
            unit, factor = _UNITS[name]
            lines.append(f"{name:8}{factor * cut[name]:>14.2f} {unit:5}{factor * missed[name]:>16.2f} {unit:5}")
        return lines


def _rms(values: np.ndarray) -> np.ndarray:
    """Return the root mean square over the first axis."""
    return np.sqrt(np.mean(np.square(values), axis=0))
