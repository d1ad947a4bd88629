"""`hugwbc report` writes its page, goes on after a stop, and refuses bad input before anything runs."""

import csv
import dataclasses
import re

import pytest

from hugwbc.cli import main
from hugwbc.evaluation import episode
from hugwbc.evaluation.experiments import EXPERIMENTS
from hugwbc.report.report_page import sections


@pytest.fixture
def short(monkeypatch):
    """The function that makes the quick runs of an experiment some short ones."""

    def short(name, **settings):
        experiment = EXPERIMENTS[name]
        section = dataclasses.replace(experiment.section, quick=lambda: [experiment.settings(**settings)])
        monkeypatch.setitem(EXPERIMENTS, name, dataclasses.replace(experiment, section=section))
        return ["report", "--experiments", name, "--workers", "1"]

    return short


def test_report_writes_page_and_csv_and_reads_what_is_stored(tmp_path, capsys, short, monkeypatch):
    out, results = tmp_path / "out", tmp_path / "results"
    words = short("contacts", gait="standing", duration=0.4, settle=0.2)
    words += ["--controllers", "hold", "learned", "--out", str(out), "--results", str(results)]
    assert main(words) == 0
    page = (out / "report.html").read_text()
    with (out / "figures.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["controller"] for row in rows} == {"hold", "learned"}
    assert "Contacts that agree with the clock" in page
    assert all(word in page for word in ("standing, hold", "standing, learned"))
    assert "few and short episodes" in page and "--controllers hold learned" in page
    assert "src=" not in page and "<script" not in page
    assert "hold is clearly better than learned in 0" in capsys.readouterr().out

    monkeypatch.setattr(episode, "rollout", None)
    assert main(words) == 0, "a finished report is only read"
    assert (out / "report.html").read_text() == page


@pytest.mark.slow
def test_the_quick_profile_from_end_to_end(tmp_path):
    """Every experiment with the controller that falls at once: the real results fit the report."""
    out = tmp_path / "out"
    words = ["report", "--controllers", "hold", "--workers", "1", "--out", str(out)]
    assert main([*words, "--results", str(tmp_path / "results")]) == 0
    page = (out / "report.html").read_text()
    assert all(f">{section.title}</h2>" in page for _, section in sections())
    assert page.count("<figure>") > 12 and "nan" not in re.sub(r"<svg.*?</svg>", "", page.lower(), flags=re.DOTALL)


def test_bad_input_is_refused_before_anything_runs(tmp_path, capsys):
    out = ["--out", str(tmp_path / "out"), "--results", str(tmp_path / "results")]
    for words, message in (
        (["report", "--experiments", "contact"], "Did you mean 'contacts'"),
        (["report", "--controllers", "qp", "qp"], "give at least one, each once"),
        (["report", "--controllers", "learned=nothing"], "unknown policy 'nothing'"),
        (["report", "--seed", "-4"], "hugwbc: seed is -4; give 0 or more"),
    ):
        assert main([*words, *out]) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "results").exists()
