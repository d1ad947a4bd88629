"""An installation without the extra [learned]: everything but policies and their training."""

import json
import shutil
import subprocess
import sys

import pytest

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


# One process for all, because importing takes longer than the work: what the QP does, and what each command answers.
SCRIPT = """
import contextlib, io, json
import hugwbc.viz.meshcat_scene, hugwbc.report.comparison_page, hugwbc.gym
from hugwbc import Command, Gait, load_robot
from hugwbc.cli import main
from hugwbc.evaluation.experiments import EXPERIMENTS
from hugwbc.runtime import Constant, Simulation, UpperBodySource, load_controller, rollout
from hugwbc.scripts import load_script
from hugwbc.targets import HandTargets
from hugwbc.tasks import TASK_NAMES, load_task

hands = HandTargets.of((0.35, 0.2, 0.2), (0.35, -0.2, 0.2))
source = Constant(Command(v_x=0.3, gait=Gait.WALKING), hands)
trace = rollout(
    load_controller("qp"), source, Simulation(sensing="exact"), UpperBodySource(load_robot()), duration=1.0
)
said = {"fell": trace.fell, "messages": trace.safety.messages, "tasks": [load_task(name).name for name in TASK_NAMES]}
said["wave"] = load_script("wave").duration
for words in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(words)
    said[" ".join(words)] = code, out.getvalue(), err.getvalue()
print(json.dumps(said))
"""
PLAY = ["play", "--viewer", "none"]
NEEDING = [PLAY, ["compare"], ["train"]]
WORKING = [[*PLAY, "--controller", "qp", "--duration", "0.3"], ["check"]]
EXPORTED = [*PLAY, "--controller", "h1.onnx", "--duration", "0.5", "--v-x", "0.3"]


@pytest.fixture(scope="module")
def said(tmp_path_factory, exported_h1):
    """What a process says that can import neither torch nor safetensors."""
    folder = tmp_path_factory.mktemp("without")
    shutil.copy(exported_h1, folder)
    words = [sys.executable, "-c", BLOCK + SCRIPT, json.dumps([*NEEDING, *WORKING, EXPORTED])]
    done = subprocess.run(words, capture_output=True, text=True, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in folder.iterdir()] == ["h1.onnx"], "what is refused leaves nothing"
    return json.loads(done.stdout)


def test_the_qp_walks_reaches_and_does_tasks(said):
    assert not said["fell"] and not said["messages"]
    assert said["tasks"] == list(TASK_NAMES) and said["wave"] > 0


@pytest.mark.parametrize("words", NEEDING)
def test_what_needs_torch_says_what_to_install(said, words):
    code, _, err = said[" ".join(words)]
    assert code == 2 and "Traceback" not in err, err
    assert "needs torch, which is not installed" in err and "hugwbc[learned]" in err


def test_the_command_line_works_with_the_qp_and_an_exported_policy(said):
    for words in (*WORKING, EXPORTED):
        code, out, err = said[" ".join(words)]
        assert not code, out + err
    out = said["check"][1]
    assert out.count("left out: torch is not installed") == 2 and "all is well" in out
