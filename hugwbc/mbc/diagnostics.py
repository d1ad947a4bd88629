"""What the controller says about its last tick."""

import dataclasses
import enum
from collections.abc import Sequence

import numpy as np

from hugwbc.mbc.gait_plan import Mode
from hugwbc.mbc.qp import CONTACT_POINTS, QpStatus
from hugwbc.mbc.tasks.task import Task, TaskTerms


class Output(enum.Enum):
    """Where a joint command came from."""

    SOLUTION = "solution"
    HELD = "last good solution"
    DAMPING = "damping"


@dataclasses.dataclass(frozen=True, eq=False)
class TaskError:
    """Desired minus actual of one task, with its unit."""

    value: np.ndarray
    unit: str


@dataclasses.dataclass(frozen=True, eq=False)
class Diagnostics:
    """State of the controller after a tick.

    Attributes:
        output: where the joint command came from.
        status: of the QP; FAILED also when it was not tried because the state was not finite.
        iterations: of the QP solver.
        mode: of the gait plan.
        swing: side of the foot in the air, or None.
        forces: of the ground on `CONTACT_POINTS`, world axes [N], shape (4, 3); zero without a solution.
        tasks, terms: every task that counted, and what it gave to the QP.
        next_foothold: where the sole's centre of the swing foot is to land, world x and y [m], or None.
        fallbacks: ticks since the reset whose command did not come from a solution.
        relaxed: ticks since the reset whose joint limits had to be dropped.
        report: what of the command was clamped, replaced or not followed as asked.
    """

    output: Output = Output.DAMPING
    status: QpStatus = QpStatus.FAILED
    iterations: int = 0
    mode: Mode = Mode.STANDING
    swing: str | None = None
    forces: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((len(CONTACT_POINTS), 3)))
    tasks: Sequence[Task] = ()
    terms: Sequence[TaskTerms] = ()
    next_foothold: np.ndarray | None = None
    fallbacks: int = 0
    relaxed: int = 0
    report: tuple[str, ...] = ()

    @property
    def contact_forces(self) -> dict[str, np.ndarray]:
        """Forces by contact point, world axes [N], each of shape (3,)."""
        return dict(zip(CONTACT_POINTS, self.forces, strict=True))

    @property
    def task_errors(self) -> dict[str, TaskError]:
        """Errors by task name."""
        return {task.name: TaskError(t.error, task.unit) for task, t in zip(self.tasks, self.terms, strict=True)}
