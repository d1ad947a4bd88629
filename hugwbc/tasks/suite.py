"""The tasks of the suite, by name: the constant `TASK` of the module of that name, loaded on request.

Tasks of the user's own are entry points in the group `hugwbc.tasks`, or Python files with a constant `TASK`.

Modules of tasks are not imported by name here: stored results depend on all code that a module imports, and a change to
one task would then invalidate the results of all others.
"""

import functools
import importlib
import pathlib
from importlib.metadata import EntryPoint

from hugwbc import extensions
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.tasks.task import Task

GROUP = "hugwbc.tasks"
TASK_NAMES = (
    "press_button",
    "fetch_box",
    "deliver_box",
    "lift_from_stool",
    "push_cart",
    "open_door",
    "open_drawer",
    "carry_tray",
    "wipe_table",
    "stack_boxes",
    "hold_payload",
)


@functools.cache
def registered_tasks() -> dict[str, EntryPoint]:
    """Return the tasks that other packages register, by name."""
    ours = {name: f"hugwbc.tasks.{name}:TASK" for name in TASK_NAMES}
    return {name: entry for name, entry in extensions.registered(GROUP, "task", ours).items() if name not in ours}


def load_task(name: str) -> Task:
    """Return a task.

    Args:
        name: one of `TASK_NAMES`, the name of a registered task, or the path of a Python file with a `TASK`, which ends
            in .py; it is run.
    """
    if name in TASK_NAMES:
        return importlib.import_module(f"hugwbc.tasks.{name}").TASK
    if name in registered_tasks():
        return _registered(registered_tasks()[name])
    path = pathlib.Path(name)
    if path.suffix != extensions.SUFFIX:
        if path.with_suffix(extensions.SUFFIX).is_file():
            raise ConfigError(f"there is no task '{name}' in the suite; for the file, give {path}{extensions.SUFFIX}")
        raise UnknownNameError("task", name, (*TASK_NAMES, *registered_tasks(), "or a file that ends in .py"))
    task = getattr(extensions.run_file(path, "TASK"), "TASK", None)
    if not isinstance(task, Task):
        raise ConfigError(f"{path} has no task; give it a constant TASK, as docs/how-to/add-a-task.md says")
    return task


def _registered(entry: EntryPoint) -> Task:
    task = extensions.load_entry(entry, "task")
    if not isinstance(task, Task):
        raise ConfigError(
            f"task '{entry.name}' ({entry.value}) is a {type(task).__name__}; register a hugwbc.tasks.Task"
        )
    if task.name != entry.name:
        raise ConfigError(f"task '{entry.name}' ({entry.value}) calls itself '{task.name}'; give both one name")
    return task
