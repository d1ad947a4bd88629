"""What a behaviour may know at a tick: the estimate, corrected by a motion capture that sees robot and objects."""

import collections
import math
from collections.abc import Iterable
from typing import Protocol

import numpy as np

from hugwbc import rotations
from hugwbc.errors import HugwbcError
from hugwbc.kinematics import Kinematics
from hugwbc.numeric import changed
from hugwbc.robot import SIDES, Robot
from hugwbc.runtime.capture_check import LONGEST_AGE, CaptureCheck
from hugwbc.scripts.view import Grip, SeenObjects, View
from hugwbc.sim import Engine
from hugwbc.sim.scenes.objects import Picture
from hugwbc.state import RobotState

CORRECTION_TIME = 0.25  # [s], over which the robot's seen poses are averaged; odometry holds it steady in between
SILENT_TIME = 0.5  # [s] without a picture, after which no object is seen
SMOOTHING_TIME = 0.1  # [s], over which an object's seen poses are averaged


class Average:
    """The share of a new measurement in a running average, which is the mean at first, then an exponential average."""

    def __init__(self, time_constant: float) -> None:
        """Average over a time [s]."""
        self._time_constant = time_constant
        self.reset()

    def reset(self) -> None:
        """Forget all measurements."""
        self._count, self._last = 0, 0.0

    def share(self, time: float) -> float:
        """Return the share of a measurement of a time [s]; 0 if it has been counted already."""
        if self._count and time <= self._last:
            return 0.0
        since, self._last = time - self._last, time
        self._count += 1
        return max(1.0 / self._count, 1.0 - math.exp(-since / self._time_constant)) if self._count > 1 else 1.0


class SeenRobot:
    """The estimated pose of the pelvis, corrected by the poses that a motion capture sees.

    The estimate is smooth, but its position and heading drift; what is seen is noisy and late, but does not drift. Each
    picture is compared with the estimate of its own time, and the difference fades in over `CORRECTION_TIME`.
    """

    def __init__(self) -> None:
        self._average = Average(CORRECTION_TIME)
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._average.reset()
        self._way, self._shift, self._turn = np.zeros(3), np.zeros(3), 0.0
        self._before: np.ndarray | None = None
        # Times, estimated ways and headings of the last ticks, oldest first.
        self._past: collections.deque[tuple[float, np.ndarray, float]] = collections.deque(maxlen=256)

    def corrected(self, state: RobotState, picture: Picture | None) -> RobotState:
        """Return the estimate, its position, heading, velocity and forces moved to the world of the picture."""
        if state.position is None or picture is None:
            return state
        if self._before is None:
            self._way = state.position.copy()
        else:
            self._way = self._way + rotations.rotation_z(self._turn) @ (state.position - self._before)
        self._before = state.position.copy()
        self._past.append((state.time, self._way, state.yaw))
        while len(self._past) > 2 and self._past[1][0] < state.time - LONGEST_AGE:
            self._past.popleft()
        share = self._average.share(picture.time)
        if share > 0.0:
            way, yaw = self._at(picture.time)
            self._shift = self._shift + share * (picture.robot[:3] - way - self._shift)
            seen = float(rotations.yaw_of(picture.robot[3:]))
            self._turn += share * float(rotations.wrap_angle(seen - yaw - self._turn))
        return self._placed(state)

    def _at(self, time: float) -> tuple[np.ndarray, float]:
        """Return way and heading of the estimate at a time, between two ticks."""
        late = next((i for i, entry in enumerate(self._past) if entry[0] >= time), len(self._past) - 1)
        after, before = self._past[late], self._past[max(late - 1, 0)]
        span = after[0] - before[0]
        part = min(max((time - before[0]) / span, 0.0), 1.0) if span > 0.0 else 1.0
        turned = float(rotations.wrap_angle(after[2] - before[2]))
        return before[1] + part * (after[1] - before[1]), before[2] + part * turned

    def _placed(self, state: RobotState) -> RobotState:
        turn = rotations.rotation_z(self._turn)
        quaternion = np.array([math.cos(0.5 * self._turn), 0.0, 0.0, math.sin(0.5 * self._turn)])
        return changed(
            state,
            position=self._way + self._shift,
            orientation=rotations.multiply(quaternion, state.orientation),
            velocity=None if state.velocity is None else turn @ state.velocity,
            foot_force=None if state.foot_force is None else state.foot_force @ turn.T,
            hand_force=None if state.hand_force is None else state.hand_force @ turn.T,
        )


class World(Protocol):
    """What a motion capture sees of robot and objects, and what the grippers hold."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the objects."""
        ...

    def picture(self) -> Picture | None:
        """Return the newest picture; None without one."""
        ...

    def held(self, side: str) -> str | None:
        """Return what the gripper of a hand holds; None for nothing."""
        ...

    def grip(self, grips: tuple[Grip, ...]) -> None:
        """Take the gripper requests of this tick."""
        ...

    def note(self, problem: str) -> None:
        """Tell whoever judges or watches the run what has gone wrong."""
        ...


class SimulatedWorld:
    """The world of a simulation."""

    def __init__(self, simulation: Engine) -> None:
        """Look at a simulation."""
        self._simulation = simulation

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the objects."""
        return self._simulation.objects.names

    def picture(self) -> Picture | None:
        """Return the newest picture; None without a scene."""
        return self._simulation.objects.picture()

    def held(self, side: str) -> str | None:
        """Return what the gripper of a hand holds; None for nothing."""
        gripper = self._simulation.gripper
        return None if gripper is None else gripper.held(side)

    def grip(self, grips: tuple[Grip, ...]) -> None:
        """Carry out the gripper requests."""
        if grips:
            carry_out(grips, self._simulation)

    def note(self, problem: str) -> None:
        """Note a problem of the scene, for the verdict."""
        self._simulation.objects.problems.append(problem)


class Sight:
    """Builds the `View` of every tick from the estimate, the motion capture and the grippers."""

    def __init__(self, world: World, robot: Robot, *, noisy: bool = True, drifting: bool = True) -> None:
        """Look at a world; the hands are where the joints of `robot` say.

        Args:
            world: what is seen.
            robot: the robot that the behaviour is told (`View.robot`).
            noisy: whether the objects are seen with noise, which is averaged.
            drifting: whether position and heading of the estimate drift, so that they are corrected by what is seen.
        """
        self._world, self._noisy, self._drifting = world, noisy, drifting
        self._kinematics = Kinematics(robot)
        self._robot, self._check = SeenRobot(), CaptureCheck()
        self._average = Average(SMOOTHING_TIME)
        self._seen: tuple[str, ...] = ()  # names of the objects in the last picture that was admitted
        self._names: tuple[str, ...] = ()  # of the objects whose poses follow
        self._poses: np.ndarray | None = None
        self._silent = False

    def reset(self) -> None:
        """Forget the past before a new run."""
        self._silent = False
        self._robot.reset()
        self._check.reset()
        self._average.reset()
        self._poses = None

    def look(self, time: float, state: RobotState) -> View:
        """Return the view at a time [s]."""
        newest, refused = self._world.picture(), self._check.refusal
        picture = self._check.admitted(newest, state) if self._drifting else newest
        if picture is newest:  # an earlier picture that is admitted instead keeps the objects that it showed
            self._seen = self._world.names
        if self._drifting:
            state = self._robot.corrected(state, picture)
        age = 0.0
        if picture is not None:  # the last admitted picture may be old
            age = max(state.time - picture.time, 0.0) if self._drifting else picture.age
        silent = age > SILENT_TIME
        if silent and not self._silent:
            self._world.note(f"motion capture silent for {SILENT_TIME:g} s at {time:.1f} s: no object is seen")
        self._silent = silent
        if self._check.refusal and not refused:
            self._world.note(self._check.refusal)
        self._kinematics.update(state)
        return View(
            time=time,
            state=state,
            hands=np.array([self._kinematics.position(f"{side}_hand") for side in SIDES]),
            objects=self._objects(None if self._check.refusal or silent else picture, age),
            hand_force=state.hand_force,
            held=(self._world.held(SIDES[0]), self._world.held(SIDES[1])),
            robot=self._kinematics.robot,
            hand_tip=self._kinematics.robot.hand_tip,
            hand_half_width=self._kinematics.robot.hand_half_width,
        )

    def grip(self, grips: tuple[Grip, ...]) -> None:
        """Pass on the gripper requests of this tick."""
        self._world.grip(grips)

    def _objects(self, picture: Picture | None, age: float) -> SeenObjects:
        if picture is None:
            return SeenObjects()
        names = self._seen
        if not self._noisy:
            return SeenObjects(names, picture.poses, age)
        share = self._average.share(picture.time)
        if self._poses is None or names != self._names:  # a motion capture may lose objects and find others
            self._names, self._poses = names, picture.poses
        elif share > 0.0:
            seen = picture.poses.copy()
            opposite = np.einsum("ij,ij->i", seen[:, 3:], self._poses[:, 3:]) < 0.0
            seen[opposite, 3:] *= -1.0  # the same turn, written with the sign of the average
            mean = self._poses + share * (seen - self._poses)
            mean[:, 3:] /= np.linalg.norm(mean[:, 3:], axis=1, keepdims=True)
            self._poses = mean
        return SeenObjects(names, self._poses, age)


def carry_out(grips: Iterable[Grip], simulation: Engine) -> None:
    """Carry out requests to the idealised gripper.

    A request that raises leaves the hand as it is, and is noted in the problems of the scene. A request for an object
    out of reach is not noted: whoever asked sees that the hand holds nothing. Without grippers nothing happens.
    """
    for grip in grips:
        try:
            if simulation.gripper is None:
                continue
            if grip.name is None:
                simulation.gripper.release(grip.side)
            else:
                simulation.gripper.attach(grip.name, grip.side, grip.breaking_force, hook=grip.hook)
        except HugwbcError as error:
            if str(error) not in simulation.objects.problems:
                simulation.objects.problems.append(str(error))
