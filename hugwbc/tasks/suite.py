"""The tasks of the suite, by name: the constant `TASK` of the module of that name, loaded when it is asked for.

Modules of tasks are not imported by name here: stored results depend on all code that a module imports, and a change to
one task would then invalidate the results of all others.
"""

import importlib
import importlib.util
import pathlib
import types

from hugwbc.errors import ConfigError, HugwbcError, UnknownNameError
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


def modules_of(name: str) -> tuple[str, ...]:
    """Return the dotted names of the modules of this package on which a task may depend, beside those of every task.

    Args:
        name: one of `TASK_NAMES`, or the path of a Python file.
    """
    return (f"hugwbc.tasks.{name}",) if name in TASK_NAMES else ("hugwbc.tasks.boxes", "hugwbc.tasks.judges")


def load_task(name: str) -> Task:
    """Return a task.

    Args:
        name: one of `TASK_NAMES`, or the path of a Python file with a `TASK`, which ends in .py; it is run.

    Raises:
        UnknownNameError: if there is no such task.
        ConfigError: if the file is not there, cannot be run, or has no task.
    """
    if name in TASK_NAMES:
        return importlib.import_module(f"hugwbc.tasks.{name}").TASK
    path = pathlib.Path(name)
    if path.suffix != ".py":
        raise UnknownNameError("task", name, (*TASK_NAMES, "or a file that ends in .py"))
    task = getattr(_run_file(path), "TASK", None)
    if not isinstance(task, Task):
        raise ConfigError(f"{path} has no task; give it a constant TASK, as docs/how-to/add-a-task.md says")
    return task


def _run_file(path: pathlib.Path) -> types.ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None  # for a name that ends in .py
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except FileNotFoundError as error:
        raise ConfigError(f"there is no file {error.filename}; give the path of a Python file with a TASK") from error
    except (HugwbcError, SyntaxError, ImportError, NameError, TypeError, ValueError) as error:
        raise ConfigError(f"{path} cannot be run: {type(error).__name__}: {error}") from error
    return module
