"""Recorded actions, carried out: again as they were recorded, or those of a policy that has learned from them."""

import dataclasses
from collections.abc import Callable

import numpy as np

from hugwbc.behaviours import Action, Course, View
from hugwbc.behaviours.hands import in_frame, stature, targets
from hugwbc.commands import Command
from hugwbc.controller import Controller
from hugwbc.gait import Gait
from hugwbc.hand_wrench import BREAKING_FORCE
from hugwbc.robot import SIDES
from hugwbc.runtime.trace import RECORD_PERIOD
from hugwbc.scripts.view import Grip
from hugwbc.sim import Simulation
from hugwbc.sim.scenes import REACH
from hugwbc.targets import HAND_FRAMES
from hugwbc.tasks.demonstration import ACTION_SIZES, Demonstration, demonstrate
from hugwbc.tasks.task import Task

Nearest = Callable[[str], tuple[str, bool] | None]
"""Returns the name of what the gripper of a side can take now, and whether that moves in a joint; None for nothing."""


def nearest_in(simulation: Simulation) -> Nearest:
    """Return what finds the object nearest to a hand within the reach of its gripper."""
    names = simulation.objects.names
    free = [name for name in names if simulation.model.body(name).jntnum[0] > 0]
    movable = {name: simulation.objects[name].travel is not None for name in free}

    def nearest(side: str) -> tuple[str, bool] | None:
        gripper = simulation.gripper
        if gripper is None or not movable:
            return None
        distance, name = min((gripper.distance(name, side), name) for name in movable)
        return (name, movable[name]) if distance <= REACH else None

    return nearest


def grips(view: View, wanted: np.ndarray, took: list[bool], nearest: Nearest) -> tuple[Grip, ...]:
    """Return the requests to the grippers. After a grip broke, the gripper must be opened first.

    Args:
        view: now.
        wanted: numbers for the left and the right gripper, shape (2,). One should hold something if its number is above
            0.5 in size, by a hook if it is negative. The grip breaks at the default force for the size of the robot,
            times the size of the number where that is above 1.
        took: whether each has held something since it was asked to; updated.
        nearest: finds what a gripper closes on.
    """
    requests = []
    for hand, side in enumerate(SIDES):
        held = view.held[hand]
        if abs(wanted[hand]) <= 0.5:
            took[hand] = False
            if held is not None:
                requests.append(Grip(side, None))
        elif held is not None:
            took[hand] = True
        elif not took[hand] and (found := nearest(side)) is not None:
            name, jointed = found
            # A second hand on an object may turn, and so may one on a thing that moves in a joint: an arm has four
            # joints, and its weld would fight the other one.
            hook = wanted[hand] < 0.0 or jointed or name in (*view.held, *(asked.name for asked in requests))
            force = BREAKING_FORCE * stature(view.robot) ** 3 * max(abs(float(wanted[hand])), 1.0)
            requests.append(Grip(side, name, hook, force))
    return tuple(requests)


def recorded_action(row: np.ndarray, view: View) -> tuple[Action, np.ndarray]:
    """Return the action of a recorded row without its grips, and these as `grips` wants them, shape (2,).

    Args:
        row: finite numbers in the order of `ACTION_NAMES`.
        view: now; the hands' targets are relative to it.
    """
    # What was stored in single precision gets its decimals back: 0.1, not 0.10000000149.
    parts = np.split(np.round(np.asarray(row, dtype=float), 7), np.cumsum(ACTION_SIZES)[:-1])
    command, gait, points, given, directions, forces, grip, (together, whole_body), frame, stiffness = parts
    told = Command.from_array(command, Gait(int(np.clip(np.round(gait[0]), 0, len(Gait) - 1))))
    if not (given > 0.5).any():
        return Action(told), grip
    lengths = np.linalg.norm(directions.reshape(2, 3), axis=1)
    pointing = [
        vector / length if length > 0.5 else None
        for vector, length in zip(directions.reshape(2, 3), lengths, strict=True)
    ]
    hands = targets(
        np.where(given[:, None] > 0.5, points.reshape(2, 3), np.nan),
        "heading",
        bool(together > 0.5),
        (pointing[0], pointing[1]),
        forces.reshape(2, 3),
        float(stiffness[0]) if stiffness[0] > 0.0 else None,
    )
    held_in = HAND_FRAMES[int(np.clip(np.round(frame[0]), 0, len(HAND_FRAMES) - 1))]
    hands = in_frame(view, dataclasses.replace(hands, whole_body=bool(whole_body > 0.5)), held_in)
    return Action(told, hands), grip


def follow(view: View, row_at: Callable[[float], np.ndarray | None], nearest: Nearest) -> Course:
    """Carry out recorded rows until there is none for the time of a view [s].

    Rows that are equal are one action, whose targets stay in its frame: a policy at 10 Hz gives each five times.
    """
    row, action, wanted, took = None, Action(), np.zeros(2), [False, False]
    while (asked := row_at(view.time)) is not None:
        if row is None or not np.array_equal(asked, row):
            row, (action, wanted) = asked, recorded_action(asked, view)
        view = yield dataclasses.replace(action, grips=grips(view, wanted, took, nearest))
    return view


def replay(
    task: Task, controller: Controller, simulation: Simulation, actions: np.ndarray, *, seed: int
) -> Demonstration:
    """Run an episode by its recorded actions in place of the task's behaviour.

    Args:
        task: the task.
        controller: that of the recording.
        simulation: as in the recording, with the same seed.
        actions: the recorded rows, shape (T, names of `ACTION_NAMES`).
        seed: that of the simulation.
    """
    rows, nearest = list(actions), nearest_in(simulation)

    def row_at(time: float) -> np.ndarray | None:
        frame = int(time / RECORD_PERIOD + 1e-6)
        return rows[frame] if frame < len(rows) else None

    return demonstrate(task, controller, simulation, seed=seed, behaviour=lambda view: follow(view, row_at, nearest))
