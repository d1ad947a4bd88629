import io
import json
import pathlib
import subprocess
import sys
import time

import pytest

from hugwbc.cli import output
from hugwbc.cli.bench import BenchOptions
from hugwbc.errors import ConfigError


def test_json_has_null_where_there_is_no_number(tmp_path):
    path = tmp_path / "a" / "b.json"
    output.write_json(path, {"x": float("nan"), "y": [1.0, float("inf")], "z": (True, None)})
    assert json.loads(path.read_text()) == {"x": None, "y": [1.0, None], "z": [True, None]}
    output.write_json(None, {})
    output.write_json(path, {"file": pathlib.Path("motions/wave.npz")})
    assert json.loads(path.read_text()) == {"file": "motions/wave.npz"}


def test_json_to_standard_output_keeps_it_clean(capsys):
    output.write_json(pathlib.Path("-"), {"a": 1})
    output.say("for people", pathlib.Path("-"))
    printed = capsys.readouterr()
    assert json.loads(printed.out) == {"a": 1} and printed.err == "for people\n"


def test_the_time_left_follows_from_the_work_and_not_from_what_was_stored_or_from_starting():
    """40 % were stored; the first two of two processes' episodes take 30 s longer than the others, which take 20 s."""
    pace, said = output.Pace(), []
    for now, done in ((0.0, 0.4), (50.0, 0.43), (50.3, 0.46), (70.0, 0.49), (70.4, 0.52), (90.0, 0.58)):
        pace.add(now, done)
        said.append(pace.left)
    assert said == ["", "", "", "about 6 min left", "about 3 min left", "about 2 min left"]


def test_progress_prints_plain_lines_when_it_takes_long(monkeypatch, capsys):
    monkeypatch.setattr(output, "_LINE_INTERVAL", 0.2)
    monkeypatch.setattr(output, "_QUIET", 0.0)
    with output.progress("walk") as advance:
        for fraction in (0.1, 0.4):  # done in one burst: one line for both
            advance(fraction)
        time.sleep(0.7)  # nothing new, no line
    assert capsys.readouterr().err.splitlines()[:-1] == ["walk: 40 %"], "nothing is known of the rest"


def test_short_work_shows_no_progress(capsys):
    with output.progress("blink") as advance:
        advance(1.0)
    assert capsys.readouterr().err == ""


def test_progress_is_a_bar_on_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr(output.sys.stderr, "isatty", lambda: True, raising=False)
    with output.progress("walk") as advance:
        advance(0.5)
    assert "walk" in capsys.readouterr().err


def test_trying_whether_a_file_can_be_written_leaves_nothing_and_changes_nothing(tmp_path):
    output.check_writable(tmp_path / "a" / "new.json")
    (tmp_path / "old.json").write_text("{}")
    output.check_writable(tmp_path / "old.json")
    assert not (tmp_path / "a").exists()
    with output.output_folder(tmp_path / "a" / "b"):
        assert [path.name for path in (tmp_path / "a").iterdir()] == ["b"] and not any((tmp_path / "a" / "b").iterdir())
    assert (tmp_path / "old.json").read_text() == "{}"
    assert [path.name for path in tmp_path.iterdir()] == ["old.json"], "nothing was written to the new folders"
    with pytest.raises(ConfigError, match="can be written"):
        output.check_writable(tmp_path / "old.json" / "c")
    with pytest.raises(ConfigError, match="can be written"), output.output_folder(tmp_path / "old.json" / "c"):
        pass
    with pytest.raises(ConfigError, match="is a file; give a folder"), output.output_folder(tmp_path / "old.json"):
        pass


def test_only_new_and_empty_folders_are_removed(tmp_path):
    (tmp_path / "old").mkdir()
    with pytest.raises(KeyError), output.output_folder(tmp_path / "old" / "new"):
        raise KeyError
    assert [path.name for path in tmp_path.rglob("*")] == ["old"], "the older folder stays, empty as it is"
    with pytest.raises(KeyError), output.output_folder(tmp_path / "used" / "new"):
        (tmp_path / "used" / "new" / "file").touch()
        raise KeyError
    assert (tmp_path / "used" / "new" / "file").exists()


def test_work_goes_on_when_nobody_reads_any_more(tmp_path):
    """As with `hugwbc compare | head`, whose files are written after its table."""
    script = "from hugwbc.cli.output import STDOUT, say, write_json; import pathlib, sys; "
    script += "[say('x' * 9999) for _ in range(50)]; write_json(STDOUT, {}); pathlib.Path('done').touch()"
    words = [sys.executable, "-c", script]
    with subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b"" and process.wait(60) == 0
    assert (tmp_path / "done").exists()


def test_what_a_terminal_cannot_show_is_escaped(monkeypatch):
    terminal = io.TextIOWrapper(io.BytesIO(), "latin-1")
    monkeypatch.setattr(sys, "stdout", terminal)
    output.say("Stra\u00dfe")
    output.say("\u03bb \ud800\nend")
    assert terminal.buffer.getvalue() == b"Stra\xdfe\n\\u03bb \\ud800\nend\n"


def test_options_are_named_without_their_classes_and_a_home_is_expanded_anywhere(monkeypatch):
    monkeypatch.setenv("HOME", "/home/one")
    assert output.parse(BenchOptions, ["--json=~/speed.json"], "bench").json == pathlib.Path("/home/one/speed.json")
    with pytest.raises(ConfigError, match=r"^seconds is -1.0; it should be greater than 0$"):
        output.parse(BenchOptions, ["--seconds", "-1"], "bench")
