"""`hugwbc docs`: what comes with the package can be listed and read."""

import pathlib
import pydoc
import re

import pytest
import yaml

from hugwbc import reference as documents
from hugwbc.behaviours import walk_to
from hugwbc.cli import main
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.reference import FURTHER, PACKAGES, document, document_names, document_title, exported, reference
from hugwbc.scripts import SCRIPT_NAMES

ROOT = pathlib.Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *(page for page in (ROOT / "docs").rglob("*.md") if "log" not in page.parts)]
SAID = {name for page in PAGES for name in re.findall(r"`hugwbc docs ([\w./-]+)`", page.read_text())}


def test_the_list_has_every_document_with_its_title(capsys):
    assert main(["docs"]) == 0
    printed = capsys.readouterr().out
    for name in ("getting-started", "tasks", "how-to/add-a-task"):
        assert f"{name} " in printed and document_title(name) in printed
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")}
    assert {name for name in document_names() if "/" not in name} == pages
    assert not any(name.startswith(("api", "log")) for name in document_names())


@pytest.mark.parametrize("name", ["how-to/add-a-task", "add-a-task", "docs/how-to/add-a-task.md"])
def test_a_document_is_printed_whole(name, capsys):
    assert main(["docs", name]) == 0
    assert capsys.readouterr().out.rstrip() == (ROOT / "docs/how-to/add-a-task.md").read_text().rstrip()


def test_a_document_is_formatted_on_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    assert main(["docs", "tasks"]) == 0
    printed = capsys.readouterr().out
    assert document_title("tasks") in printed and "](" not in printed


def test_an_unknown_document_is_answered_with_the_nearest(capsys):
    assert main(["docs", "add-a-tusk"]) == 2
    assert "unknown document 'add-a-tusk'. Did you mean" in capsys.readouterr().err
    for name in ("../pyproject", "/etc/passwd", ""):
        with pytest.raises(UnknownNameError):
            document(name)


def test_an_installation_without_documents_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(documents, "__file__", str(tmp_path / "hugwbc" / "documents.py"))
    with pytest.raises(ConfigError, match="reinstall"):
        document_names()


def test_scripts_are_listed_and_printed(capsys):
    assert main(["docs"]) == 0
    printed = capsys.readouterr().out
    assert all(f"{name} " in printed for name in SCRIPT_NAMES) and "Stand still." in printed
    assert main(["docs", "wave"]) == 0
    assert yaml.safe_load(capsys.readouterr().out)["segments"]
    assert "cup" in printed and main(["docs", "fetch_cup"]) == 0
    assert "def fetch_cup" in capsys.readouterr().out
    assert main(["docs", "wav"]) == 2
    assert "Did you mean 'wave'?" in capsys.readouterr().err


@pytest.mark.parametrize("package", [*PACKAGES, "hugwbc.gym"])
def test_every_name_that_programs_import_is_in_the_reference(package):
    page = (ROOT / "docs/api/index.md").read_text()
    (row,) = [line for line in page.splitlines() if line.startswith(f"| `{package}` ")]
    assert [name for name in exported(package) if name != "__version__"] == re.findall(r"`(\w+)`", row.split("|")[2])
    for name in exported(package) if package in PACKAGES else ():
        entry = reference(f"{package}.{name}")
        assert entry.startswith(f"from {package} import {name}\n") and len(entry.splitlines()) >= 3
        assert not re.search(r"Annotated\[|FieldInfo|<function|<class", entry)


@pytest.mark.parametrize("name", sorted(FURTHER))
def test_what_ones_own_functions_are_given_is_in_the_reference(name):
    entry = reference(name)
    assert f"from {FURTHER[name]} import {name}\n\n{name}(" in entry
    assert not re.search(r"Annotated\[|FieldInfo|<function|<class", entry)


def test_a_name_with_two_meanings_has_both():
    entry = reference("Schedule")
    assert "from hugwbc.learned.config import Schedule\n" in entry
    assert "from hugwbc.evaluation.plans import Schedule\n" in entry
    assert reference("hugwbc.evaluation.plans.Schedule") in entry


def test_a_step_shows_its_types_by_name_with_their_ranges(capsys):
    assert main(["docs", "walk_to"]) == 0
    printed = capsys.readouterr().out
    assert "position: Place | None = None," in printed and "WalkSpeed: float from 0.05 to 0.6\n" in printed
    assert "highest speed [m/s]" in printed
    assert "speed: WalkSpeed = 0.4, keep_yaw: bool = False" in pydoc.plain(pydoc.render_doc(walk_to))


@pytest.mark.parametrize("name", ["hugwbc.behaviours", "api/behaviours", "docs/api/behaviours.md"])
def test_a_package_lists_what_it_exports(name, capsys):
    assert main(["docs", name]) == 0
    assert "BoxGrip              How two hands hold a box." in capsys.readouterr().out
    assert main(["docs", "walk_too"]) == 2
    assert "Did you mean 'walk_to'?" in capsys.readouterr().err


@pytest.mark.parametrize("name", sorted(SAID))
def test_what_the_documents_say_to_read_is_there(name, capsys):
    assert main(["docs", name]) == 0
    assert len(capsys.readouterr().out.splitlines()) >= 3
