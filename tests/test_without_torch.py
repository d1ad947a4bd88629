"""An installation without the extra [learned]: everything but policies and their training."""

import subprocess
import sys
import textwrap

import pytest

from hugwbc.learned.policy import load_policy
from hugwbc.learned.policy.onnx_export import export_onnx
from hugwbc.tasks import TASK_NAMES

# As if they were not installed. None in sys.modules would not do: tyro then takes torch for loaded.
BLOCK = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("torch", "safetensors"):
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)

sys.meta_path.insert(0, Missing())
"""


def run(script, folder):
    """Run a script in a process that can import neither torch nor safetensors."""
    words = [sys.executable, "-c", BLOCK + textwrap.dedent(script)]
    return subprocess.run(words, capture_output=True, text=True, cwd=folder, check=False)


def test_the_qp_walks_reaches_and_does_tasks(tmp_path):
    done = run(
        """
        import hugwbc.viz.meshcat_scene, hugwbc.report.comparison_page, hugwbc.gym
        from hugwbc import Command, Gait, load_robot
        from hugwbc.evaluation.experiments import EXPERIMENTS
        from hugwbc.runtime import Constant, Simulation, UpperBodySource, load_controller, rollout
        from hugwbc.scripts import load_script
        from hugwbc.targets import HandTargets
        from hugwbc.tasks import TASK_NAMES, load_task

        hands = HandTargets.of((0.35, 0.2, 0.2), (0.35, -0.2, 0.2))
        source = Constant(Command(v_x=0.3, gait=Gait.WALKING), hands)
        arms = UpperBodySource(load_robot())
        trace = rollout(load_controller("qp"), source, Simulation(sensing="exact"), arms, duration=1.0)
        assert not trace.fell and not trace.safety.failures, trace.safety.messages
        print(len([load_task(name) for name in TASK_NAMES]), load_script("wave").duration > 0)
        """,
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(len(TASK_NAMES)), "True"]


@pytest.mark.parametrize("words", [["play", "--viewer", "none"], ["compare"], ["train"]])
def test_what_needs_torch_says_what_to_install(tmp_path, words):
    done = run(f"from hugwbc.cli import main\nsys.exit(main({words!r}))", tmp_path)
    assert done.returncode == 2 and not list(tmp_path.iterdir()), done.stderr
    assert "needs torch, which is not installed" in done.stderr and "hugwbc[learned]" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_command_line_works_with_the_qp(tmp_path):
    done = run(
        """
        from hugwbc.cli import main
        sys.exit(main(["play", "--controller", "qp", "--viewer", "none", "--duration", "0.3"]) or main(["check"]))
        """,
        tmp_path,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("left out: torch is not installed") == 2 and "all is well" in done.stdout


def test_an_exported_policy_runs(tmp_path):
    export_onnx(load_policy(), tmp_path / "h1.onnx")
    words = ["play", "--controller", "h1.onnx", "--viewer", "none", "--duration", "0.5", "--v-x", "0.3"]
    done = run(f"from hugwbc.cli import main\nsys.exit(main({words!r}))", tmp_path)
    assert done.returncode == 0, done.stderr
