import subprocess
import sys

import gymnasium

import hugwbc.gym
from hugwbc.gym import H1, TASK_ENVIRONMENTS
from hugwbc.tasks import TASK_NAMES

HEAVY = ("torch", "mujoco", "pinocchio", "placo")


def test_every_task_has_an_environment():
    assert tuple(TASK_ENVIRONMENTS.values()) == TASK_NAMES
    words = {name: name.removeprefix("hugwbc/").removesuffix("-v0").lower() for name in TASK_ENVIRONMENTS}
    assert {name: task.replace("_", "") for name, task in TASK_ENVIRONMENTS.items()} == words
    assert {*TASK_ENVIRONMENTS, H1, "hugwbc/Task-v0"} == {name for name in gymnasium.registry if "hugwbc/" in name}


def test_registering_again_changes_nothing(recwarn):
    before = dict(gymnasium.registry)
    hugwbc.gym.register()
    assert gymnasium.registry == before and not recwarn.list


def test_registration_loads_no_simulator():
    script = f"import sys, hugwbc.gym; print([name for name in {HEAVY} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_without_gymnasium_the_message_says_what_to_install():
    script = "import sys; sys.modules['gymnasium.envs'] = None; import hugwbc.gym"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert result.returncode == 1 and "pip install 'hugwbc[gym]'" in result.stderr
