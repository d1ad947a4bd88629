"""A robot at one time, the record of a run, its file, and the watch over touch-downs.

A file of a record is one .npz with every array and a text for the rest, without pickled objects.
"""

import dataclasses
import io
import json
import math
import pathlib
from typing import Any

import numpy as np

from hugwbc.errors import ConfigError, HugwbcError
from hugwbc.files import write_whole, writing
from hugwbc.robot_tables import DEFAULT_ROBOT
from hugwbc.runtime.safety_report import SafetyReport
from hugwbc.scripts.motion import UNREADABLE
from hugwbc.settings_file import parse
from hugwbc.sim.scenes.scene import Scene

RECORD_PERIOD = 0.02  # [s] between two samples
CONTACT_FORCE = 1.0  # [N]; a foot with a larger vertical ground reaction counts as on the ground
IMPACT_TIME = 0.01  # [s]; the force of an impact is averaged over it, so that it hardly depends on the time step
SHORTEST_SWING = 0.05  # [s]; a foot that leaves the ground for a shorter time has bounced, not stepped
_FORMAT = 2
_ABOUT = "about"  # name of the array of a file that holds the text


@dataclasses.dataclass(frozen=True, eq=False)
class Snapshot:
    """One robot at one time, in the world frame.

    Attributes:
        qpos: pelvis position [m], quaternion (w, x, y, z) and joint positions [rad], shape (7 + n,).
        gait: value of `Gait`.
        phase: the controller's common gait phase in [0, 1); NaN without one.
        foot_contact: whether the left and the right foot are on the ground, shape (2,), bool.
        foot_force: ground reaction on each foot [N], shape (2, 3).
        pressure_centre: point where that force acts [m], shape (2, 3); NaN for a foot in the air.
        foothold: where the controller plans to put the centre of each sole next, x and y [m], shape (2, 2); NaN for a
            foot without a plan.
        hand_target_world: targets of both hands [m], shape (2, 3); NaN without one.
        arm_target: arm joint positions that the inverse kinematics or a motion asks for [rad], shape (k,); NaN where
            the controller moves the arms.
        hand_force: force on each hand from outside [N], shape (2, 3).
        object_pose: position [m] and quaternion (w, x, y, z) of every body of the scene, in the order of
            `Scene.body_names`, shape (bodies, 7).
    """

    qpos: np.ndarray
    gait: int
    phase: float
    foot_contact: np.ndarray
    foot_force: np.ndarray
    pressure_centre: np.ndarray
    foothold: np.ndarray
    hand_target_world: np.ndarray
    arm_target: np.ndarray
    hand_force: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((2, 3)))
    object_pose: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 7)))


SNAPSHOT_FIELDS = tuple(field.name for field in dataclasses.fields(Snapshot))
SCENE_FIELDS = ("hand_force", "object_pose")  # which a record has only of a robot among objects


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Trace:
    """The record of one run: T samples, one every `RECORD_PERIOD`.

    `write_trace` keeps it in a file, `hugwbc.viz.show.keep_replay` writes a page that replays it.

    Attributes:
        name: name of the controller.
        time: times of the samples [s], shape (T,).
        command: the eight commanded values, clamped to their ranges, in the order of COMMAND_NAMES, shape (T, 8). They
            include the h, p and w of hand targets that ask for the whole body, but not what `feasible` and `Braking`
            change thereafter (`runtime.command_chain`), which therefore counts as error.
        measured: v_x, v_y, omega, h, p, w as executed (see `kinematics.Measured`), shape (T, 6).
        clearance: height of the left and right sole above the ground [m], shape (T, 2).
        qpos, gait, phase, foot_contact, foot_force, pressure_centre, foothold: those of `Snapshot`, in T rows.
        hand_target_world, arm_target, hand_force, object_pose: likewise; the last two are empty without a scene.
        qvel: pelvis velocity [m/s], angular velocity in its own frame and joint velocities [rad/s], shape (T, 6 + n).
        target: joint position targets of the joint command at this time [rad], shape (T, n).
        hand_error: distance of each hand to its target, reachable or not [m], shape (T, 2); NaN without a target.
        reachable: whether the inverse kinematics can reach each hand's target, shape (T, 2), bool.
        torque: joint torques in the physics step before this time [N*m], shape (T, n).
        power: sum_i |tau_i dq_i|, mean over the physics steps since the sample before [W], shape (T,); 0 at the first.
        tick_ms: time that each call of the controller took [ms], shape (number of calls,).
        ik_ms: time that each call of the arms' source took [ms], shape (number of calls,).
        touch_downs: times at which the left and the right foot came down after a swing of at least `SHORTEST_SWING`,
            at the resolution of the physics [s].
        touch_down_velocity: velocity of each foot's sole in the physics step before each of its `touch_downs`, world
            frame [m/s], shape (touch-downs, 3) for each foot.
        stance_peak: largest vertical ground reaction, averaged over `IMPACT_TIME`, in the stance after each of the
            `touch_downs` [N], shape (touch-downs,) for each foot. The last stance may be cut short by the end.
        mass: mass of the robot's description, without a payload [kg].
        fell: whether the robot fell or the physics diverged.
        survived_s: time of the first fall, or of the end of the run [s].
        steps: number of control steps executed.
        safety: what was changed on the way to the joints.
        robot: name of the simulated robot.
        scene: the objects around the robot, as drawn; None for none.
        problems: what went wrong with the objects, such as one that left the world.
    """

    name: str
    time: np.ndarray
    command: np.ndarray
    gait: np.ndarray
    measured: np.ndarray
    clearance: np.ndarray
    phase: np.ndarray
    foot_contact: np.ndarray
    foot_force: np.ndarray
    pressure_centre: np.ndarray
    foothold: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    target: np.ndarray
    hand_target_world: np.ndarray
    arm_target: np.ndarray
    hand_error: np.ndarray
    reachable: np.ndarray
    torque: np.ndarray
    power: np.ndarray
    tick_ms: np.ndarray
    ik_ms: np.ndarray
    touch_downs: tuple[np.ndarray, np.ndarray]
    touch_down_velocity: tuple[np.ndarray, np.ndarray]
    stance_peak: tuple[np.ndarray, np.ndarray]
    mass: float
    fell: bool
    survived_s: float
    steps: int
    safety: SafetyReport
    robot: str = DEFAULT_ROBOT
    hand_force: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 2, 3)))
    object_pose: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0, 7)))
    scene: Scene | None = None
    problems: tuple[str, ...] = ()

    @property
    def down(self) -> bool:
        """Whether the robot did not stay up: it fell, or it knelt down since its state or a motor was lost."""
        return self.fell or self.safety.lowered > 0

    @property
    def fate(self) -> str:
        """How the run ended, as a part of a sentence, such as "stayed up for 6.0 s" or "fell after 1.2 s"."""
        if self.fell:
            return f"fell after {self.survived_s:.1f} s"
        if self.down:
            return "knelt down, since the state or a motor was lost"
        return f"stayed up for {self.survived_s:.1f} s"

    def __repr__(self) -> str:
        """Return one line: who, how long, how it ended."""
        around = f", {len(self.scene.objects)} objects" if self.scene is not None else ""
        return f"Trace('{self.name}', {len(self.time)} samples, {self.fate}, {self.robot}{around})"


def write_trace(path: str | pathlib.Path, trace: Trace) -> pathlib.Path:
    """Write a record to a file and return its path; .npz is added to a name without it."""
    path = pathlib.Path(path)
    path = path if path.suffix == ".npz" else path.with_name(f"{path.name}.npz")
    arrays: dict[str, np.ndarray] = {}
    about: dict[str, Any] = {"format": _FORMAT, "pairs": []}
    for field in dataclasses.fields(Trace):
        value = getattr(trace, field.name)
        if isinstance(value, np.ndarray):
            arrays[field.name] = value
        elif field.name == "scene":
            about["scene"] = None if value is None else scene_text(value)
        elif field.name == "safety":
            about["safety"] = dataclasses.asdict(value)
        elif isinstance(value, tuple) and field.name != "problems":  # one array for each foot
            about["pairs"].append(field.name)
            arrays |= {f"{field.name}/{foot}": entry for foot, entry in enumerate(value)}
        else:
            about[field.name] = value
    file = io.BytesIO()
    arrays[_ABOUT] = np.array(json.dumps(about))
    np.savez_compressed(file, allow_pickle=False, **arrays)
    with writing(path):
        write_whole(path, file.getvalue())
    return path


def read_trace(path: str | pathlib.Path) -> Trace:
    """Read a record that `write_trace` wrote; raise a ConfigError for any other file."""
    path = pathlib.Path(path)
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        about = json.loads(str(arrays.pop(_ABOUT)[()]))
        if about.pop("format") != _FORMAT:
            raise ConfigError(f"{path} was written by another version of hugwbc; run it again to record it anew")
        for name in about.pop("pairs"):
            arrays[name] = (arrays.pop(f"{name}/0"), arrays.pop(f"{name}/1"))
        about["safety"] = SafetyReport(**about["safety"] | {"messages": tuple(about["safety"]["messages"])})
        about["problems"] = tuple(about["problems"])
        if about["scene"] is not None:
            about["scene"] = parse(Scene, about["scene"], path)
        return Trace(**about, **arrays)
    except OSError as error:
        raise ConfigError(
            f"cannot read {path}: {error.strerror or error}; give a file that write_trace wrote"
        ) from error
    except HugwbcError:
        raise
    except (*UNREADABLE, TypeError, AttributeError) as error:
        raise ConfigError(f"{path} is not a recorded run ({error}); give a file that write_trace wrote") from error


def scene_text(scene: Scene) -> str:
    """Return a scene without variation as text that `settings_file.parse` reads: JSON, which is YAML as well."""
    things = []
    for thing in scene.objects:
        fields = {field.name: getattr(thing, field.name) for field in dataclasses.fields(thing)}
        given = {name: value for name, value in fields.items() if value is not None}
        if "mjcf" in given:
            given["mjcf"] = str(pathlib.Path(given["mjcf"]).resolve())
        else:
            given = {"kind": thing.kind, **given}
        things.append(given)
    whole = {"about": scene.about, "robot": scene.robot, "ground": scene.ground, "objects": things}
    return json.dumps({name: value for name, value in whole.items() if value is not None}, ensure_ascii=False)


class TouchDownWatch:
    """A watch over both feet of one run, called after every physics step."""

    def __init__(self, timestep: float) -> None:
        """Begin with both feet on the ground; the physics time step is in [s]."""
        # Vertical forces of the last physics steps within IMPACT_TIME, written in turn.
        self._count = max(1, round(IMPACT_TIME / timestep))
        self._forces = [[0.0] * self._count for _ in range(2)]
        self._turn = 0
        self._last_contact = [0.0, 0.0]  # [s]
        self._velocity = np.zeros((2, 3))
        self._peak = [0.0, 0.0]  # of the current stance
        self._times: tuple[list[float], list[float]] = ([], [])
        self._velocities: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
        self._peaks: tuple[list[float], list[float]] = ([], [])

    def update(self, now: float, force: np.ndarray, velocity: np.ndarray) -> None:
        """Take the feet after a physics step.

        Args:
            now: time after the step [s].
            force: ground reactions in the world frame [N], shape (2, 3).
            velocity: velocities of the soles in the world frame [m/s], shape (2, 3).
        """
        self._turn = (self._turn + 1) % self._count
        for foot, normal in enumerate(force[:, 2].tolist()):  # of two numbers, floats are faster than arrays
            if normal > CONTACT_FORCE:
                # A shorter time in the air is a bounce of the contact; its forces belong to the same stance.
                if now - self._last_contact[foot] > SHORTEST_SWING:
                    self._land(foot, now)
                self._last_contact[foot] = now
            forces = self._forces[foot]
            forces[self._turn] = normal if -math.inf < normal < math.inf else 0.0  # diverged physics does not count
            mean = sum(forces) / self._count
            if mean > self._peak[foot]:
                self._peak[foot] = mean
        self._velocity[:] = velocity

    def _land(self, foot: int, now: float) -> None:
        if self._times[foot]:  # a stance from the start of the run follows no touch-down
            self._peaks[foot].append(self._peak[foot])
        self._peak[foot] = 0.0
        self._times[foot].append(now)
        # The contact force slows the sole within a step, so the speed of the impact is that of the step before.
        self._velocities[foot].append(self._velocity[foot].copy())

    def record(self) -> dict[str, Any]:
        """Return `touch_downs`, `touch_down_velocity` and `stance_peak` of a `Trace`."""
        current = [[peak] if times else [] for peak, times in zip(self._peak, self._times, strict=True)]
        return {
            "touch_downs": tuple(map(np.array, self._times)),
            "touch_down_velocity": tuple(np.array(found).reshape(-1, 3) for found in self._velocities),
            "stance_peak": tuple(np.array(closed + last) for closed, last in zip(self._peaks, current, strict=True)),
        }
