"""The recipes of docs/how-to do what they say."""

import json
import pathlib

import pytest
from docs_pages import ROOT, blocks, follow

from hugwbc.cli import main
from hugwbc.cli.check import CHECK_FAILED
from hugwbc.files import digest

HOW_TO = ROOT / "docs" / "how-to"


@pytest.mark.slow
def test_add_a_command_script(folder: pathlib.Path, package: pathlib.Path) -> None:
    follow(HOW_TO / "add-a-command-script.md", folder, package)
    assert (folder / "out" / "inspect" / "replay.html").exists()


def test_add_a_controller(folder: pathlib.Path) -> None:
    (balancer,) = [block for block in blocks(HOW_TO.parent / "getting-started.md") if block.title == "balancer.py"]
    (folder / "balancer").mkdir()
    (folder / "balancer" / "balancer.py").write_text(balancer.text)
    follow(HOW_TO / "add-a-controller.md", folder, in_processes=True)
    assert (folder / "out" / "balancer" / "report.html").exists()


def test_change_the_training(folder: pathlib.Path, capsys: pytest.CaptureFixture[str]) -> None:
    follow(HOW_TO / "change-the-training.md", folder)
    policy = folder / "runs" / "apart" / "policy.safetensors"
    assert main(["check", "--policy", str(policy)]) == CHECK_FAILED
    written = digest((folder / "apart.py").read_bytes())
    assert f"no recipe made it; hugwbc train with apart.py {written} did" in capsys.readouterr().out


def test_add_a_task(folder: pathlib.Path) -> None:
    follow(HOW_TO / "add-a-task.md", folder)
    (row,) = json.loads((folder / "touch_post.json").read_text())["rows"]
    assert row["success"] and not row["reason"]


@pytest.mark.slow
def test_use_gymnasium_to_the_end(folder: pathlib.Path) -> None:
    follow(HOW_TO / "use-gymnasium.md", folder, slow=True)


def test_add_an_experiment(folder: pathlib.Path) -> None:
    follow(HOW_TO / "add-an-experiment.md", folder)
    assert [row["speed"] for row in json.loads((folder / "stopping.json").read_text())["rows"]] == [0.4, 0.8]


@pytest.mark.slow
def test_make_a_policy_again(folder: pathlib.Path) -> None:
    follow(HOW_TO / "make-a-policy-again.md", folder)
    assert (folder / "runs" / "walk" / "policy.safetensors").exists()


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "page",
    [
        *("add-an-observation", "add-an-object", "use-gymnasium", "use-your-own-simulator"),
        pytest.param("add-a-robot", marks=SLOW),
    ],
)
def test_a_page_is_followed(folder: pathlib.Path, page: str) -> None:
    follow(HOW_TO / f"{page}.md", folder)


@pytest.mark.parametrize("page", ["add-a-sensor", "add-a-behaviour", pytest.param("add-a-gait", marks=SLOW)])
def test_a_page_that_changes_the_package_is_followed(folder: pathlib.Path, package: pathlib.Path, page: str) -> None:
    follow(HOW_TO / f"{page}.md", folder, package)
