"""Take an unknown weight in each hand, and hold both still for 10 s."""

import numpy as np

from hugwbc.robot import SIDES
from hugwbc.scripts.behaviours import Course, Grip, View, seen
from hugwbc.sim.scenes.varied import settled
from hugwbc.tasks.judges import happened, rise
from hugwbc.tasks.moves import Moves, up
from hugwbc.tasks.record import TaskRecord
from hugwbc.tasks.task import Shapes, Task, scene_of
from hugwbc.tasks.verdict import Milestone, longest

HELD = 10.0  # [s]
NEAR = 0.03  # [m]
LIFT = 0.10  # [m]
WEIGHTS = ("left-weight", "right-weight")
_UP = 0.03  # [m]
_ABOVE = 0.05  # [m], of the hand's origin above the weight: a hand is 3 cm thick below it


class HoldPayload(Moves):
    """Put both hands on the weights, grip them, lift, and hold."""

    timeout = 40.0

    def __init__(self, shapes: Shapes) -> None:
        """Take the heights of the weights from the shapes."""
        self._half = settled(shapes[WEIGHTS[0]]["height"]) / 2  # type: ignore[arg-type]

    def course(self, view: View) -> Course:  # noqa: D102
        self.doing = "reach for the weights"
        weights = np.array([seen(view, name).position for name in WEIGHTS])
        at = weights + up(self._half + _ABOVE) - np.array([0.02, 0.0, 0.0])
        view = yield from self.glide(view, at + up(0.06), frame="world")
        view = yield from self.glide(view, at, frame="world", speed=0.1)
        self.doing = "grip the weights"
        grips = [Grip(side, name) for side, name in zip(SIDES, WEIGHTS, strict=True)]
        view = yield from self.grip(view, *grips)
        self.doing = "lift the weights"
        taken = view.hands
        view = yield from self.glide(view, taken + up(LIFT), frame="world", speed=0.05)
        self.doing = "hold the weights"
        return (yield from self.carry(view, taken + up(LIFT), HELD + 5.0))


def both_up(record: TaskRecord) -> np.ndarray:
    """Return whether both weights are in a hand and off the table, shape (T,)."""
    up = np.all([rise(record, name) > _UP for name in WEIGHTS], axis=0)
    return up & (record.held >= 0).all(axis=1)


def held_still(record: TaskRecord) -> np.ndarray:
    """Return whether both hands are within 3 cm of 10 cm above where they took the weights, shape (T,)."""
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
    behaviour=HoldPayload,
    limit=45.0,
    milestones=MILESTONES,
    idealised=("attach",),
)
