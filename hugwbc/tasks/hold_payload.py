"""Take an unknown weight in each hand, and hold both still for 10 s."""

import numpy as np

from hugwbc.behaviours import Action, Course, Grip, View, doing, glide, grip, seen, standing, step
from hugwbc.behaviours.boxes import up
from hugwbc.behaviours.course import Seconds
from hugwbc.behaviours.hands import targets
from hugwbc.robot import SIDES
from hugwbc.tasks.judges import happened, rise
from hugwbc.tasks.record import TaskRecord
from hugwbc.tasks.task import Shapes, Task, scene_of
from hugwbc.tasks.verdict import Milestone, longest

HELD = 10.0  # [s]
NEAR = 0.03  # [m]
LIFT = 0.10  # [m]
WEIGHTS = ("left-weight", "right-weight")
_UP = 0.03  # [m]
_LOAD_GAIN = 1.0  # [1/s], at which targets move against the sag of hands that carry a load
_LARGEST_SAG = 0.15  # [m]
_ABOVE = 0.05  # [m], of the hand's origin above the weight: a hand is 3 cm thick below it


@step
def hold_payload(view: View, shapes: Shapes, *, timeout: Seconds = 40.0) -> Course:
    """Put both hands on the weights, grip them, lift, and hold."""
    half = shapes[WEIGHTS[0]]["height"] / 2
    weights = np.array([seen(view, name).position for name in WEIGHTS])
    at = weights + up(half + _ABOVE) - np.array([0.02, 0.0, 0.0])
    above = at + up(0.06)
    # Straight up first: on the way from beside the body a hand that points down would knock a weight over.
    beside = np.column_stack((view.hands[:, :2], above[:, 2]))
    for points in (beside, above):
        view = yield from doing("reach for the weights", glide(view, points, frame="world"))
    view = yield from doing("reach for the weights", glide(view, at, frame="world", speed=0.1))
    grips = [Grip(side, name) for side, name in zip(SIDES, WEIGHTS, strict=True)]
    view = yield from doing("grip the weights", grip(view, *grips))
    goal = view.hands + up(LIFT)
    view = yield from doing("lift the weights", glide(view, goal, frame="world", speed=0.05))
    return (yield from doing("hold the weights", _hold(view, goal, HELD + 5.0)))


def _hold(view: View, goal: np.ndarray, seconds: float) -> Course:
    """Hold loaded hands at points of the world for a time [s]: the targets move against the sag of the arms."""
    begin = last = view.time
    shift = np.zeros((2, 3))
    while view.time - begin < seconds:
        shift += _LOAD_GAIN * (view.time - last) * (goal - view.hands)
        shift = np.clip(shift, -_LARGEST_SAG, _LARGEST_SAG)
        last = view.time
        view = yield Action(standing(view), targets(goal + shift, "world"))
    return view


def both_up(record: TaskRecord) -> np.ndarray:
    """Return whether both weights are in a hand and off the table, shape (T,), bool."""
    up = np.all([rise(record, name) > _UP for name in WEIGHTS], axis=0)
    return up & (record.held >= 0).all(axis=1)


def held_still(record: TaskRecord) -> np.ndarray:
    """Return whether both hands are within 3 cm of the points 10 cm above their grips, shape (T,), bool."""
    still = both_up(record)
    for hand in range(2):
        taken = np.flatnonzero(record.held[:, hand] >= 0)
        if taken.size:
            goal = record.hands[taken[0], hand] + [0.0, 0.0, LIFT]
            still = still & (np.linalg.norm(record.hands[:, hand] - goal, axis=1) <= NEAR)
    return still


MILESTONES = (
    happened(lambda record: set(WEIGHTS) <= set(record.gripped), "a weight was not taken"),
    Milestone("the weights were not lifted", lambda record: 1.0 if both_up(record).any() else 0.0),
    Milestone("the hands were not within 3 cm for 10 s", lambda record: longest(held_still(record)) / (HELD - 1e-9)),
)

TASK = Task(
    name="hold_payload",
    about="Take an unknown weight of 0 to 4 kg in each hand, lift both by 10 cm, and hold them for 10 s.",
    scene=scene_of("hold_payload"),
    behaviour=hold_payload,
    limit=45.0,
    milestones=MILESTONES,
    idealised=("attach",),
)
