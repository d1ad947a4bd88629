import csv
import json

import pytest

from hugwbc.cli import main

WORDS = ["report", "--protocols", "contacts", "--workers", "1"]


@pytest.fixture
def short(monkeypatch):
    """A profile of one short cell."""
    from hugwbc.evaluation import protocols
    from hugwbc.evaluation.report import profiles
    from hugwbc.gait import Gait

    def cells(settings):
        config = protocols.ContactsConfig(Gait.STANDING, duration=0.4, settle=0.2, **settings)
        yield "contacts", config, protocols.run_contacts

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
    assert "few and short episodes" in page and "--controllers hold learned" in text
    assert "src=" not in page and "<script" not in page
    assert "not told apart" in capsys.readouterr().out

    monkeypatch.setattr("hugwbc.evaluation.episode.rollout", None)
    assert main(words) == 0, "a finished report is only read"
    assert (out / "report.html").read_text() == page


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
    (path,) = (tmp_path / "results" / "cells").iterdir()
    path.write_text(json.dumps(json.loads(path.read_text()) | {"version": 99}))
    before = path.read_bytes()
    assert main(words) == 2
    assert "has format version 99" in capsys.readouterr().err
    assert path.read_bytes() == before
