"""The suite of loco-manipulation tasks: scenes, behaviours, and judges that see the true states.

`docs/tasks.md` says what each task asks for.
"""

from hugwbc.tasks.record import Ending, TaskRecord
from hugwbc.tasks.run_task import TaskRun, run_task
from hugwbc.tasks.task import TASK_NAMES, Shapes, Task, load_task, shapes_of
from hugwbc.tasks.verdict import Milestone, Verdict

__all__ = [
    "TASK_NAMES",
    "Ending",
    "Milestone",
    "Shapes",
    "Task",
    "TaskRecord",
    "TaskRun",
    "Verdict",
    "load_task",
    "run_task",
    "shapes_of",
]
