"""Registration of the environments with gymnasium. Nothing here loads MuJoCo or torch."""

from types import MappingProxyType

H1 = "hugwbc/H1-v0"

# Identifiers of the tasks' environments, and the tasks. A task in a user's file is hugwbc/Task-v0 with task=FILE.
TASK_ENVIRONMENTS = MappingProxyType(
    {
        "hugwbc/PressButton-v0": "press_button",
        "hugwbc/FetchBox-v0": "fetch_box",
        "hugwbc/LiftFromStool-v0": "lift_from_stool",
        "hugwbc/PushCart-v0": "push_cart",
        "hugwbc/OpenDoor-v0": "open_door",
        "hugwbc/OpenDrawer-v0": "open_drawer",
        "hugwbc/CarryTray-v0": "carry_tray",
        "hugwbc/WipeTable-v0": "wipe_table",
        "hugwbc/StackBoxes-v0": "stack_boxes",
        "hugwbc/HoldPayload-v0": "hold_payload",
    }
)
_ANY_TASK = "hugwbc/Task-v0"
_TASK_CLASS = "hugwbc.gym.task_env:TaskEnv"


def register() -> None:
    """Register all environments with gymnasium; registered ones stay unchanged.

    Raises:
        ImportError: if gymnasium is not installed.
    """
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
