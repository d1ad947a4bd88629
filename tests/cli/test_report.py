import csv
import json
import shutil
import subprocess
import sys
import time

import pytest

from hugwbc.cli import main
from hugwbc.gait import Gait
from hugwbc.learned.policy import policy_dir
from hugwbc.report.report_page import sections

WORDS = ["report", "--protocols", "contacts", "--workers", "1"]


@pytest.fixture
def short(monkeypatch):
    """A profile of one short cell."""
    from hugwbc.evaluation.protocols.contacts import ContactsConfig
    from hugwbc.report import profiles

    def cells(settings):
        yield "contacts", ContactsConfig(Gait.STANDING, duration=0.4, settle=0.2, **settings)

    monkeypatch.setitem(profiles.PROFILES, "quick", cells)


def test_report_writes_page_markdown_and_csv_and_reads_what_is_stored(tmp_path, capsys, short, monkeypatch):
    out, results = tmp_path / "out", tmp_path / "results"
    words = [*WORDS, "--controllers", "hold", "learned", "--out", str(out), "--results", str(results)]
    assert main(words) == 0
    page, text = (out / "report.html").read_text(), (out / "report.md").read_text()
    with (out / "figures.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["controller"] for row in rows} == {"hold", "learned"}
    assert "Contacts that agree with the clock" in page and "| standing [%] | 100 | 100 |" in text
    assert all(word in page for word in ("level 0.25", "Curricula", "standing, hold", "standing, learned"))
    assert "few and short episodes" in page and "--controllers hold learned" in text and "ablation" not in text
    assert "src=" not in page and "<script" not in page
    assert "too close to call" in capsys.readouterr().out

    monkeypatch.setattr("hugwbc.evaluation.engine.episode.rollout", None)
    assert main(words) == 0, "a finished report is only read"
    assert (out / "report.html").read_text() == page


def test_policies_of_the_ablation_stand_beside_the_papers_of_their_training(tmp_path, short, monkeypatch):
    from hugwbc.evaluation.protocols.intervention import InterventionConfig
    from hugwbc.learned.policy import checkpoint, policy_file
    from hugwbc.report import profiles

    def cells(settings):
        yield "intervention", InterventionConfig(Gait.STANDING, episodes=9, duration=0.2, settle=0.1, **settings)

    monkeypatch.setitem(profiles.PROFILES, "quick", cells)
    tensors, metadata = checkpoint.load_file(policy_file(), "policy")
    metadata["training"]["config"]["env"]["intervention"] = "motion"
    checkpoint.save_file(tmp_path / "mine" / "policy.safetensors", tensors, "policy", metadata)
    words = ["report", "--controllers", "hold", "--ablation", str(tmp_path / "mine"), "--workers", "1"]
    assert main([*words, "--out", str(tmp_path / "out"), "--results", str(tmp_path / "results")]) == 0
    text = (tmp_path / "out" / "report.md").read_text()
    assert "no policy trained with noise, nor trained without intervention" in text
    noise, motion, none = (
        f"HugWBC, paper, trained {words}" for words in ("with noise", "with motions", "without inter")
    )
    (head,) = {line for line in text.splitlines() if "learned mine" in line and line.startswith("|")}
    assert head.startswith(f"|  | {noise} | hold | {motion} | learned mine | {none}vention |")


def test_a_report_that_was_stopped_goes_on_and_has_the_same_numbers(tmp_path, short, monkeypatch):
    from hugwbc.evaluation.engine import episode
    from hugwbc.evaluation.protocols.ramp import RampConfig
    from hugwbc.report import profiles

    def cells(settings):
        yield "ramp", RampConfig(Gait.STANDING, episodes=2, duration=3.4, settle=3.0, **settings)

    monkeypatch.setitem(profiles.PROFILES, "quick", cells)
    whole, calls = episode.rollout, []

    def stopping(*args, **settings):
        calls.append(args)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return whole(*args, **settings)

    words = ["report", "--controllers", "hold", "--workers", "1", "--out", str(tmp_path / "out")]
    assert main([*words, "--results", str(tmp_path / "other")]) == 0
    figures = (tmp_path / "out" / "figures.csv").read_text()
    monkeypatch.setattr(episode, "rollout", stopping)
    assert main([*words, "--results", str(tmp_path / "results")]) == 130
    assert main([*words, "--results", str(tmp_path / "results")]) == 0
    assert len(calls) == 3 + 2, "four episodes, of which two were finished before"
    assert (tmp_path / "out" / "figures.csv").read_text() == figures


# The full profile with all its protocols, gaits and commands; few and short episodes. The times that effort measures
# differ from run to run: left out.
REDUCED = """
import dataclasses, sys
from hugwbc.cli import main
from hugwbc.evaluation.conditions import Conditions
from hugwbc.report import profiles

SIZES = {"points": 2, "samples": 8, "rollouts": 1, "first": 50.0, "limit": 50.0, "resolution": 0.9}
LENGTHS = {"disturbance": (0.1, 2.0), "ramp": (3.0, 3.2)}
full = profiles.PROFILES["full"]

def reduced(settings):
    for name, config in full(settings):
        names = {field.name for field in dataclasses.fields(config)}
        sizes = {size: value for size, value in SIZES.items() if size in names}
        if "episodes" in names:
            sizes["episodes"] = config.least[0]
        settle, duration = LENGTHS.get(name, (0.1, 0.3))
        changes = dict(sizes, settle=settle, duration=duration, conditions=Conditions(timestep=0.005))
        if name != "effort":
            yield name, dataclasses.replace(config, **changes)

profiles.PROFILES["full"] = reduced
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_the_full_profile_goes_on_after_a_kill_with_identical_numbers(tmp_path):
    def start(name: str) -> subprocess.Popen:
        places = ["--out", str(tmp_path / f"{name} page"), "--results", str(tmp_path / name)]
        words = ["report", "--profile", "full", "--controllers", "learned", "--workers", "2", *places]
        return subprocess.Popen([sys.executable, "-c", REDUCED, *words], stdout=subprocess.DEVNULL)

    def cells() -> dict:
        return {path.name: path.stat().st_mtime_ns for path in (tmp_path / "cut" / "cells").glob("*.json")}

    assert start("whole").wait() == 0
    process = start("cut")
    while len(cells()) < 12 and process.poll() is None:
        time.sleep(0.05)
    process.kill()
    process.wait()
    kept, whole = cells(), {path.name for path in (tmp_path / "whole" / "cells").iterdir()}
    assert 12 <= len(kept) < len(whole) and kept.keys() < whole
    assert start("cut").wait() == 0
    assert cells().keys() == whole and kept.items() <= cells().items(), "finished cells are only read"
    for file in ("report.html", "report.md", "figures.csv"):
        assert (tmp_path / "cut page" / file).read_bytes() == (tmp_path / "whole page" / file).read_bytes()
    for name in whole:
        assert (tmp_path / "cut" / "cells" / name).read_bytes() == (tmp_path / "whole" / "cells" / name).read_bytes()


@pytest.mark.slow
def test_the_quick_profile_from_end_to_end(tmp_path):
    """Every protocol with the controller that falls at once: the real results fit the report."""
    out = tmp_path / "out"
    words = ["report", "--controllers", "hold", "--workers", "1", "--out", str(out)]
    assert main([*words, "--results", str(tmp_path / "results")]) == 0
    page = (out / "report.html").read_text()
    assert all(f">{section.report_title}</h2>" in page for section in sections())
    assert page.count("<figure>") > 20 and "nan" not in page.lower().split("<svg")[0]


def test_bad_input_is_refused_before_anything_runs(tmp_path, capsys):
    out = ["--out", str(tmp_path / "out"), "--results", str(tmp_path / "results")]
    for words, message in (
        (["report", "--profile", "fast"], "unknown profile 'fast'. Valid: quick, full"),
        (["report", "--protocols", "contact"], "Did you mean 'contacts'"),
        (["report", "--controllers", "qp", "qp"], "give at least one, each once"),
        (["report", "--controllers", "learned=nothing"], "unknown policy 'nothing'"),
    ):
        assert main([*words, *out]) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "results").exists()


def test_results_of_another_version_are_refused_and_kept(tmp_path, capsys, short):
    words = [*WORDS, "--controllers", "hold", "--out", str(tmp_path / "out"), "--results", str(tmp_path / "results")]
    assert main(words) == 0
    assert "There is nothing to compare with." in capsys.readouterr().out
    (path,) = (tmp_path / "results" / "cells").iterdir()
    path.write_text(json.dumps(json.loads(path.read_text()) | {"version": 99}))
    before = path.read_bytes()
    assert main(words) == 2
    assert "has format version 99" in capsys.readouterr().err
    assert path.read_bytes() == before


def test_a_training_record_that_cannot_be_used_is_told_before_anything_runs(tmp_path, capsys):
    shutil.copytree(policy_dir() / "h1", tmp_path / "mine")
    (tmp_path / "mine" / "training.csv").write_text("steps,reward\n1,x\n")
    words = ["report", "--controllers", str(tmp_path / "mine"), "--out", str(tmp_path / "out")]
    assert main([*words, "--results", str(tmp_path / "results")]) == 2
    assert "is not a training record" in capsys.readouterr().err
    assert not (tmp_path / "results").exists()
