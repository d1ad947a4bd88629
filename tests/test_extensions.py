"""What users add from outside: packages in a folder of their own with entry points, and files on the command line."""

import importlib
import json
import subprocess
import sys
import textwrap

import pytest

from hugwbc.cli import main
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.store import controller_digest
from hugwbc.runtime.controllers import ControllerSpec, HoldController, controller_names, plugins
from hugwbc.tasks import load_task
from hugwbc.tasks.task import registered_tasks

HOLD = '''
from hugwbc.runtime import HoldController

class Mine(HoldController):
    """A controller of somebody's own."""

    name = "mine"

    def __init__(self, policy=None, robot=None):
        super().__init__(robot)
        self.policy = policy
'''


@pytest.fixture
def install(tmp_path, monkeypatch):
    """The function that puts a package into a folder as pip does: a module, and its metadata beside it."""
    forget = (plugins, registered_tasks)
    monkeypatch.syspath_prepend(str(tmp_path))

    def install(module, text, **groups):
        (tmp_path / f"{module}.py").write_text(text)
        info = tmp_path / f"{module}-1.0.dist-info"
        info.mkdir(exist_ok=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
        entries = [f"[hugwbc.{group}]\n{line}\n" for group, line in groups.items()]
        (info / "entry_points.txt").write_text("\n".join(entries))
        importlib.invalidate_caches()
        for cached in forget:
            cached.cache_clear()

    yield install
    monkeypatch.undo()
    importlib.invalidate_caches()
    for cached in forget:
        cached.cache_clear()
    for name in [key for key in sys.modules if key.startswith("own_")]:
        del sys.modules[name]


def test_a_controller_of_a_package_is_found_by_name_and_runs(install):
    install("own_hold", HOLD, controllers="mine = own_hold:Mine")
    assert "mine" in controller_names()
    assert ControllerSpec("mine", "a word").build().policy == "a word"


def test_the_code_of_a_package_tells_its_results_apart(install):
    """Its version is often the same while it is written."""
    found = []
    for text in (HOLD, HOLD + "# changed\n"):
        install("own_hold", text, controllers="mine = own_hold:Mine")
        found.append(controller_digest(ControllerSpec("mine")))
    assert found[0] != found[1]
    assert ControllerSpec("mine").identity()["package"] == "own_hold 1.0"
    assert main(["play", "--controller", "mine", "--viewer", "none", "--duration", "0.1"]) == 0


def test_a_controller_is_a_class_in_a_file(tmp_path):
    path = tmp_path / "balance.py"
    path.write_text(HOLD)
    spec = ControllerSpec.parse(f"{path}:Mine")
    controller = spec.build()
    assert controller.name == "mine" and controller.policy is None and spec.label == "mine"
    assert isinstance(controller, HoldController) and spec.takes_robot and spec.training is None
    assert ControllerSpec.parse(f"{path}:Mine=weights") == ControllerSpec(f"{path}:Mine", "weights")
    assert type(spec.build()) is type(controller), "the file runs once"
    assert main(["play", "--controller", f"{path}:Mine", "--viewer", "none", "--duration", "0.1"]) == 0
    out = tmp_path / "out"
    script = tmp_path / "short.yaml"
    script.write_text("segments: [{label: a, duration: 0.2}]")
    words = ["--script", str(script), "--controllers", f"{path}:Mine", "hold", "--out", str(out), "--no-video"]
    assert main(["compare", *words]) == 0
    assert {"mine", "hold"} <= set(json.loads((out / "summary.json").read_text())["controllers"])


def test_the_results_of_a_file_depend_on_what_is_in_it(tmp_path):
    path = tmp_path / "balance.py"
    path.write_text(HOLD)
    before = ControllerSpec(f"{path}:Mine").identity()
    path.write_text(HOLD + "\nOther = Mine\n")
    after = ControllerSpec(f"{path}:Mine")
    assert after.identity() != before and after.identity() != ControllerSpec(f"{path}:Other").identity()
    assert str(tmp_path) not in json.dumps(before)


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        (HOLD, "Your", r"has no 'Your'; it has Mine\. Give"),
        ("x = 1", "Mine", "has no 'Mine'; it defines no class or function"),
        ("Mine = 3", "Mine", "Mine is a int; give a class, or a function"),
        ("def f(:", "Mine", "cannot be run: SyntaxError"),
        ("import nowhere_at_all", "Mine", "No module named 'nowhere_at_all'.*line 1.*PYTHONPATH"),
        ("x = 0\n1 / x", "Mine", r"cannot be run: ZeroDivisionError.* \(balance.py, line 2\)"),
        ("class Mine: pass", "Mine", "gives a Mine without name, period, reset, act"),
        (HOLD + "    period = 0\n", "Mine", "has period = 0; give the time"),
        (HOLD + "Mine.name = 3\n", "Mine", "has name = 3; give a short text"),
        ("def Mine():\n    raise OSError('gone')", "Mine", r"cannot be built: OSError: gone \(balance.py, line 2"),
        ("import numpy\ndef Mine():\n    numpy.linalg.inv([[0]])", "Mine", r"LinAlgError: .* \(balance.py, line 3"),
    ],
)
def test_a_file_that_does_not_work_says_what_was_wrong(tmp_path, text, name, message):
    path = tmp_path / "balance.py"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        ControllerSpec(f"{path}:{name}").build()


def test_words_that_name_no_controller_in_a_file_are_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"there is no file .*none\.py"):
        ControllerSpec(f"{tmp_path / 'none.py'}:Mine")
    with pytest.raises(ConfigError, match=r"is a Python file; say what makes the controller in it: .*:NAME"):
        ControllerSpec(str(tmp_path / "none.py"))
    (tmp_path / "plain.py").write_text("from hugwbc.runtime import HoldController as Mine")
    with pytest.raises(ConfigError, match="takes no policy"):
        ControllerSpec(f"{tmp_path / 'plain.py'}:Mine", "weights")


def test_a_task_of_a_package_is_found_by_name(install, standing_task, capsys):
    task = standing_task(name="own_task").read_text()
    install("own_task", task, tasks="own_task = own_task:TASK")
    assert load_task("own_task").about == "Stand."
    assert main(["tasks", "--task", "own_task"]) == 0
    assert "own_task  Stand." in capsys.readouterr().out
    with pytest.raises(UnknownNameError, match="Did you mean 'own_task'"):
        load_task("own_tsk")
    install("own_wrong", "TASK = 3", tasks="own_wrong = own_wrong:TASK")
    with pytest.raises(ConfigError, match=r"task 'own_wrong' \(own_wrong:TASK\) is a int"):
        load_task("own_wrong")
    install("own_other", task, tasks="other = own_other:TASK")
    with pytest.raises(ConfigError, match="calls itself 'own_task'; give both one name"):
        load_task("other")


@pytest.mark.parametrize("words", ["own.task", "own.task.py:TASK", "own.task.py:Other"])
def test_words_that_nearly_name_the_file_of_a_task_are_told_the_file(tmp_path, monkeypatch, words):
    (tmp_path / "own.task.py").write_text("TASK = 3")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=r"for the TASK of the file, give own\.task\.py$"):
        load_task(words)


def test_a_worker_process_finds_the_controller_of_a_file(tmp_path):
    (tmp_path / "balance.py").write_text(HOLD)
    script = """
        import multiprocessing
        from hugwbc.runtime import ControllerSpec

        def name_of(spec):
            return spec.build().name

        if __name__ == "__main__":
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                print(pool.apply(name_of, (ControllerSpec("balance.py:Mine"),)))
    """
    (tmp_path / "run.py").write_text(textwrap.dedent(script))
    done = subprocess.run([sys.executable, "run.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.strip() == "mine", done.stderr
