"""Gymnasium environments: the tasks of the suite at 10 Hz, and the robot's joints at 50 Hz.

`import hugwbc.gym` registers them; then `gymnasium.make("hugwbc/FetchBox-v0", controller="qp")` builds one. What is in
an action and in an observation is said in docs/how-to/use-gymnasium.md. This module loads neither MuJoCo nor torch.
"""

from hugwbc.errors import ConfigError

__all__ = ["H1", "TASK_ENVIRONMENTS", "register"]

H1 = "hugwbc/H1-v0"

# As `hugwbc.tasks.TASK_NAMES`, which cannot be imported without the simulator.
_SUITE = (
    *("press_button", "fetch_box", "deliver_box", "lift_from_stool", "push_cart", "open_door"),
    *("open_drawer", "carry_tray", "wipe_table", "stack_boxes", "hold_payload"),
)
# Identifiers of the tasks' environments, and the tasks. A task in a user's file is hugwbc/Task-v0 with task=FILE.
TASK_ENVIRONMENTS = {f"hugwbc/{name.title().replace('_', '')}-v0": name for name in _SUITE}
_ANY_TASK = "hugwbc/Task-v0"
_TASK_CLASS = "hugwbc.gym.task_env:TaskEnv"


def register() -> None:
    """Register all environments with gymnasium; registered ones stay unchanged."""
    try:
        from gymnasium.envs import registration
    except ImportError as error:
        raise ImportError("hugwbc.gym needs gymnasium: run `pip install 'hugwbc[gym]'`") from error

    for name, task in TASK_ENVIRONMENTS.items():
        if name not in registration.registry:
            registration.register(id=name, entry_point=_TASK_CLASS, kwargs={"task": task})
    if _ANY_TASK not in registration.registry:
        registration.register(id=_ANY_TASK, entry_point=_TASK_CLASS)
    if H1 not in registration.registry:
        registration.register(
            id=H1, entry_point="hugwbc.gym.h1_env:H1Env", vector_entry_point="hugwbc.gym.h1_env:H1VectorEnv"
        )


def check_no_options(options: object) -> None:
    """Refuse options of a reset: one that is ignored would do nothing, and nobody would notice."""
    if options:
        raise ConfigError(f"options of reset are {options!r:.100}, but none are known; give None")


register()
