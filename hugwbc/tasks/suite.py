"""The tasks of the suite, by name: the constant `TASK` of the module of that name, loaded when it is asked for.

Modules of tasks are not imported by name here: stored results depend on all code that a module imports, and a change to
one task would then invalidate the results of all others.
"""

import importlib
import importlib.util

from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.tasks.task import Task

TASK_NAMES = (
    "press_button",
    "fetch_box",
    "lift_from_stool",
    "push_cart",
    "open_door",
    "open_drawer",
    "carry_tray",
    "wipe_table",
    "stack_boxes",
    "hold_payload",
)


def module_of(name: str) -> str:
    """Return the dotted name of a task's module.

    Args:
        name: one of `TASK_NAMES`, or the dotted name of a module with a `TASK`, such as `my_package.my_task`.
    """
    return f"hugwbc.tasks.{name}" if name in TASK_NAMES else name


def load_task(name: str) -> Task:
    """Return a task.

    Args:
        name: one of `TASK_NAMES`, or the dotted name of an importable module with a `TASK`.

    Raises:
        UnknownNameError: if there is no such task, and no module of that name.
        ConfigError: if the module has no task.
    """
    module = module_of(name)
    try:
        found = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        found = None
    if found is None:
        raise UnknownNameError("task", name, (*TASK_NAMES, "or a module with a TASK of its own"))
    task = getattr(importlib.import_module(module), "TASK", None)
    if not isinstance(task, Task):
        raise ConfigError(f"module {module} has no task; give it a constant TASK, as docs/how-to/add-a-task.md says")
    return task
