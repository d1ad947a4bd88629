"""What the controller says about its last tick."""

import dataclasses
import enum

import numpy as np

from hugwbc.mbc.gait_plan import Mode
from hugwbc.mbc.qp import CONTACT_POINTS, QpStatus


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
        swing: side of the swinging foot of a walk, or None.
        contact_forces: by contact point, world axes [N], each of shape (3,).
        task_errors: by task name.
        next_foothold: where the sole's centre of the foot in the air is to land, world x and y [m]; None if none or
            both are. The controller's `footholds` has both.
        fallbacks: ticks since the reset whose command did not come from a solution.
        relaxed: ticks since the reset whose joint limits had to be dropped.
        out_of_reach: ticks since the reset in which the foothold of a walk was further away than a step reaches.
        failed_plans: force plans of leaps since the reset that were not solved, in whose place the feet pushed evenly.
        report: what of the command was clamped, replaced or not followed as asked.
    """

    output: Output = Output.DAMPING
    status: QpStatus = QpStatus.FAILED
    iterations: int = 0
    mode: Mode = Mode.STANDING
    swing: str | None = None
    contact_forces: dict[str, np.ndarray] = dataclasses.field(
        default_factory=lambda: {name: np.zeros(3) for name in CONTACT_POINTS}
    )
    task_errors: dict[str, TaskError] = dataclasses.field(default_factory=dict)
    next_foothold: np.ndarray | None = None
    fallbacks: int = 0
    relaxed: int = 0
    out_of_reach: int = 0
    failed_plans: int = 0
    report: tuple[str, ...] = ()
