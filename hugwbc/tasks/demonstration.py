"""Demonstrations: observations and actions of a behaviour in an episode of a task, as frames.

A frame pairs the known state with the command that followed. All of it is estimated or seen, as on a robot; true are
only the verdict and the joint positions from which cameras are rendered.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from hugwbc.behaviours import Action, Behaviour, Course, View
from hugwbc.behaviours.hands import in_frame, points_in, stature
from hugwbc.commands import COMMAND_NAMES
from hugwbc.controller import Controller, check_controller
from hugwbc.errors import ConfigError
from hugwbc.hand_wrench import BREAKING_FORCE
from hugwbc.robot import SIDES, Robot
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.sim import Simulation
from hugwbc.targets import HAND_FRAMES
from hugwbc.tasks.run_task import run_task
from hugwbc.tasks.task import Task
from hugwbc.tasks.verdict import Verdict

FPS = round(1.0 / RECORD_PERIOD)  # frames per second: the rate of the learned controller and of every other record
STATE, OBJECTS, ACTION = "observation.state", "observation.environment_state", "action"  # columns of recordings
_AXES = ("x", "y", "z")
_POSE = (*_AXES, "qw", "qx", "qy", "qz")
_BASE = (*_POSE, *(f"v_{axis}" for axis in _AXES), *(f"omega_{axis}" for axis in _AXES))
_BOTH = ("together", "whole_body")
_STRONGEST = 100.0  # of a grip: a finite number, also where the behaviour lets nothing break it


def _of_hands(*names: str) -> tuple[str, ...]:
    return tuple(f"{side}_hand.{name}" for side in SIDES for name in names)


ACTION_NAMES = (
    *COMMAND_NAMES,
    "gait",
    *_of_hands(*_AXES),
    *_of_hands("given"),
    *_of_hands(*(f"direction_{axis}" for axis in _AXES)),
    *_of_hands(*(f"force_on_{axis}" for axis in _AXES)),  # with `force_` they would be what the hands do to others
    *_of_hands("grip"),
    *_BOTH,
    "frame",
    "stiffness",
)
"""Numbers of an action, in order; `docs/demonstrations.md` says what each of them means."""
ACTION_SIZES = (len(COMMAND_NAMES), 1, 6, 2, 6, 6, 2, len(_BOTH), 1, 1)  # of its parts


def state_names(robot: Robot) -> tuple[str, ...]:
    """Return the names of the numbers of a state, in order."""
    return (
        *(f"{name}.pos" for name in robot.joint_names),
        *(f"{name}.vel" for name in robot.joint_names),
        *(f"base.{name}" for name in _BASE),
        *_of_hands(*_AXES),
        *_of_hands(*(f"force_{axis}" for axis in _AXES)),
        *_of_hands("holds"),
    )


def pose_names(body: str) -> tuple[str, ...]:
    """Return the names of the seven numbers of an object's pose."""
    return tuple(f"{body}.{name}" for name in _POSE)


def state_vector(view: View) -> np.ndarray:
    """Return the robot's known state as one vector, in the order of `state_names`; 0 if unknown."""
    state = view.state
    return np.concatenate(
        (
            state.q,
            state.dq,
            view.position,
            state.orientation,
            np.zeros(3) if state.velocity is None else state.velocity,
            state.angular_velocity,
            view.hands.ravel(),
            np.zeros(6) if view.hand_force is None else view.hand_force.ravel(),
            [float(name is not None) for name in view.held],
        )
    )


def objects_array(view: View, bodies: Sequence[str]) -> np.ndarray:
    """Return the poses of bodies as they are seen: positions [m] and quaternions, shape (bodies, 7); 0 if unseen."""
    poses = np.zeros((len(bodies), 7))
    for row, name in enumerate(bodies):
        if name in view.objects:
            thing = view.objects[name]
            poses[row] = *thing.position, *thing.orientation
    return poses


def unrecorded(action: Action) -> tuple[str, ...]:
    """Return what a request asks of the hands that `ACTION_NAMES` has no number for."""
    hands = action.hands
    if hands is None:
        return ()
    asked = {
        "targets of the arm joints": hands.joints is not None,
        "orientations of the hands": hands.left_orientation is not None or hands.right_orientation is not None,
        "payloads": hands.wrench.payload is not None,
    }
    return tuple(what for what, given in asked.items() if given)


def action_vector(view: View, action: Action, grip: np.ndarray) -> np.ndarray:
    """Return the request as one vector, in the order of `ACTION_NAMES`.

    Targets of hands are in the heading frame, level and at the pelvis, whatever frame the behaviour used; `frame` is
    the place of that one in `HAND_FRAMES`. A hand without a target has `given` 0 and the place where it is.

    Args:
        view: what was known then.
        action: the request.
        grip: how strongly the idealised gripper of each hand should hold something, shape (2,), as in `grips`.
    """
    command, hands = action.command, action.hands
    points = points_in(view, view.hands, "heading")
    given, directions, forces, both = np.zeros(2), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(2)
    frame, stiffness = HAND_FRAMES.index("heading"), 0.0
    if hands is not None:
        frame, stiffness = HAND_FRAMES.index(hands.frame), hands.wrench.stiffness or 0.0
        hands = in_frame(view, hands, "heading")
        given = hands.given.astype(float)
        points = np.where(hands.given[:, None], hands.array(), points)
        pointing = (hands.left_direction, hands.right_direction)
        directions = np.stack([np.zeros(3) if value is None else value for value in pointing])
        forces = hands.wrench.force
        both = np.array([float(getattr(hands, name)) for name in _BOTH])
    parts = (points, given, directions, forces, grip, both, [frame, stiffness])
    return np.concatenate((command.array(), [float(command.gait)], *(np.ravel(part) for part in parts)))


@dataclasses.dataclass(frozen=True, eq=False)
class Demonstration:
    """One episode of a task: T frames, `FPS` per second, from the start until the behaviour ended."""

    task: Task  # the task
    seed: int  # seed of the scene and of the sensors
    controller: str  # name of the controller
    robot: str  # name of the robot
    state: np.ndarray  # what was known of the robot, shape (T, names of `state_names`)
    # poses of the bodies of the scene as they were seen: position [m] and quaternion (w, x, y, z), in the order of
    # `Scene.body_names`, shape (T, bodies, 7)
    objects: np.ndarray
    action: np.ndarray  # the requests, shape (T, names of `ACTION_NAMES`)
    # true positions of all joints of the simulation, from which cameras are rendered, shape (T, model.nq)
    qpos: np.ndarray
    steps: tuple[str, ...]  # what the robot was at, in the words of the behaviour, one for each frame
    verdict: Verdict  # whether the task was done, from the true states


def demonstrate(
    task: Task,
    controller: Controller,
    simulation: Simulation,
    *,
    seed: int,
    behaviour: Behaviour | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> Demonstration:
    """Run one episode of a task and return it as a demonstration; recording does not change the episode.

    Args:
        task: the task.
        controller: any object with the members of `Controller`, with a period of a frame or less.
        simulation: a robot among the objects of the task's scene: `Simulation(scene=task.scene, seed=seed)`.
        seed: that of the simulation, to be noted.
        behaviour: acts in place of the task's own; in the lengths of the simulated robot.
        on_progress: called with the fraction of the time limit.
    """
    name, period = check_controller(controller, "the controller")
    if period > RECORD_PERIOD + 1e-9:
        raise ConfigError(
            f"the period of controller '{name}' is {period:g} s; a demonstration has {FPS} frames per second: take one "
            f"with {RECORD_PERIOD:g} s or less"
        )
    watch = _Watch(simulation)

    def watched(view: View) -> Course:
        assert simulation.scene is not None
        acting = behaviour or task.behaviour_in(simulation.scene)
        return watch.course(acting(view), view)

    run = run_task(task, controller, simulation, behaviour=watched, on_progress=on_progress)
    count = len(watch.actions)  # a fall or the time limit leaves a last frame without its action
    if not count:
        raise ConfigError(f"task '{task.name}', seed {seed}, has nothing to record: {run.verdict.words}")
    if watch.unrecorded:
        what = " and ".join(sorted(watch.unrecorded))
        raise ConfigError(
            f"the behaviour asks for {what}, for which a demonstration has no numbers; record another one"
        )
    bodies = len(task.scene.body_names)
    return Demonstration(
        task=task,
        seed=seed,
        controller=run.trace.name,
        robot=run.trace.robot,
        state=np.array(watch.states[:count]).reshape(count, -1),
        objects=np.array(watch.objects[:count]).reshape(count, bodies, 7),
        action=np.array(watch.actions).reshape(count, len(ACTION_NAMES)),
        qpos=np.array(watch.positions[:count]).reshape(count, -1),
        steps=tuple(watch.steps[:count]),
        verdict=run.verdict,
    )


class _Watch:
    """Notes what a behaviour knows and asks for.

    A command reaches the robot softened, so each action is taken from the next view, which says what was carried out.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self.positions: list[np.ndarray] = []
        self.states: list[np.ndarray] = []
        self.objects: list[np.ndarray] = []
        self.actions: list[np.ndarray] = []
        self.steps: list[str] = []
        self.unrecorded: set[str] = set()
        self._grip = np.zeros(2)
        self._open: View | None = None  # of a frame that has no action yet

    def course(self, course: Course, view: View) -> Course:
        """Run a behaviour unchanged."""
        self._close(view.last)
        try:
            action = next(course)
            while True:
                self._frame(view, action.doing)
                view = yield action
                self._close(view.last)
                action = course.send(view)
        except StopIteration:
            return view

    def _close(self, action: Action) -> None:
        """Give the last frame its action, if there is a frame that waits for one."""
        for grip in action.grips:
            usual = BREAKING_FORCE * stature(self._simulation.robot) ** 3
            strength = float(np.clip(grip.breaking_force / usual, 1.0, _STRONGEST))
            strength *= -1.0 if grip.hook else 1.0
            self._grip[SIDES.index(grip.side)] = strength if grip.name is not None else 0.0
        if self._open is not None:
            self.actions.append(action_vector(self._open, action, self._grip))
            self.unrecorded.update(unrecorded(action))
            self._open = None

    def _frame(self, view: View, doing: str) -> None:
        """Begin a frame, if one is due: controllers may be faster than `FPS`."""
        if view.time < len(self.states) * RECORD_PERIOD - 1e-9:
            return
        self._open = view
        self.states.append(state_vector(view))
        self.objects.append(objects_array(view, self._simulation.objects.names))
        self.positions.append(self._simulation.data.qpos.copy())
        self.steps.append(doing)
