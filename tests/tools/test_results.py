"""The tool that writes tables into the documents: places, cells, and the commit that a table belongs to."""

import argparse
import dataclasses
import pathlib
import sys

import polars as pl
import pytest

from hugwbc.evaluation.conditions import INTERVENTIONS
from hugwbc.evaluation.experiments import intervention
from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import Estimate

ROOT = pathlib.Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tool(load_tool):
    return load_tool("results")


def test_every_table_has_its_places_and_every_place_its_table(tool) -> None:
    places = {
        (path.relative_to(ROOT).as_posix(), part["name"])
        for path in (ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("models/*/README.md"))
        for part in tool.marked(path.read_text())
    }
    assert places == {(document, name) for name, table in tool.TABLES.items() for document in table.documents}


def test_a_table_says_value_interval_number_and_what_is_worse(tool) -> None:
    title = "Single command, walking"
    figures = [
        Figure(title, "E_vy", "m/s", Estimate(0.08, 0.07, 0.09, 16), 0.085),
        Figure(title, "E_omega", "rad/s", Estimate(0.115, 0.105, 0.125, 16), 0.054),
        Figure(title, "falls", "% of episodes", Estimate(12.5, 3.5, 36.0, 16)),
        Figure(title, "E_omega", "rad/s", None, controller="another paper's", published=0.6),
        Figure(title, "touch-down speed, median", "m/s", Estimate(0.9, None, None, 16)),
    ]
    assert tool.cell(Figure(title, "sag of the hands", "cm", Estimate(0.14, 0.05, 0.2, 4))) == "0.140 (n = 4)"
    force = Figure("Tolerated force, constant", "0°", "N", Estimate(87.5, 87.5, 90.6, 16))
    assert tool.cell(force) == "87.5 to 90.6", "the bracket of a search"
    assert tool.cell(dataclasses.replace(force, estimate=Estimate(800.0, 800.0, None, 16))) == "800"
    median = Figure("Survived push", "median of all", "m/s", Estimate(0.8, 0.8, 1.0, 32))
    assert tool.cell(median) == "0.800 (0.8 to 1)", "no bracket"
    table = tool.Table((), {}, ("E_omega", "E_vy", "falls"))
    assert tool.lay_out(table, {"learned": figures}) == [
        ["", "E_omega", "E_vy", "falls"],
        ["paper, walking", "0.054", "0.085", ""],
        ["learned", "*0.115 ± 0.010*", "0.080 ± 0.010", "2 of 16 (4 to 36 %)"],
    ]
    motion = tool.lay_out(table, {"learned, noise": figures, "learned, motion": figures})
    assert [row[0] for row in motion[1:]] == ["paper, noise", "learned, noise", "paper, motion", "learned, motion"]
    figures = [dataclasses.replace(figure, reference="trained with noise") for figure in figures]
    moved = tool.lay_out(table, {"learned, noise": figures, "learned, motion": figures})
    assert [row[0] for row in moved[1::2]] == [f"paper, {kind}, trained with noise" for kind in ("noise", "motion")]
    tall = tool.lay_out(tool.Table((), {}, tall=True), {"learned": figures})
    assert tall[-1] == ["touch-down speed, median [m/s]", "", "0.900"]
    two = tool.lay_out(
        tool.Table((), {}, ("falls",), tall=True),
        {"QP": [*figures, Figure("Stops", "falls", "%", Estimate(0.0, 0.0, 20.0, 16))]},
    )
    assert [row[0] for row in two] == ["", f"{title}: falls", "Stops: falls"]


def test_the_reasons_of_failures_share_a_column(tool) -> None:
    shares = {"success": 80.0, "failed: the cup fell over": 15.0, "failed: the tray was dropped": 5.0}
    figures = [
        Figure("carry_tray", name, "% of episodes", Estimate(share, share - 4.0, share + 10.0, 20))
        for name, share in shares.items()
    ]
    table = tool.Table((), {}, ("success", tool.FAILED))
    assert tool.lay_out(table, {"QP": figures}) == [
        ["", "success [% of episodes]", "failed"],
        ["QP", "16 of 20 (76 to 90 %)", "the cup fell over: 3; the tray was dropped: 1"],
    ]
    figures = [dataclasses.replace(figure, table=f"Tasks, {figure.table}") for figure in figures]
    figures.append(Figure("Tasks, open_door", "success", "% of episodes", Estimate(100.0, 84.0, 100.0, 20)))
    cells = tool.lay_out(table, {"QP": figures, "learned": figures})
    assert [row[0] for row in cells[1:]] == [
        f"{task}: {label}" for task in ("carry_tray", "open_door") for label in ("QP", "learned")
    ]


def test_a_policy_of_the_ablation_stands_below_the_papers_of_its_training(tool) -> None:
    rows = [{"intervention": arms, "command": name} for arms in INTERVENTIONS for name in ("h", "p", "w")]
    frame = pl.DataFrame(rows).with_columns(error=0.05, fell=False, arm_error=0.0, foot_travel=0.02, foot_creep=0.01)
    found = {
        policy: intervention.figures(
            intervention.InterventionSettings(gait="standing", duration=21.0, training=training), frame
        )
        for policy, training in zip(tool.ABLATION, ("noise", "motion", "none", "noise"), strict=True)
    }
    cells = tool.lay_out(tool.TABLES["ablation-standing"], found)
    assert cells[0] == ["", "E_h", "E_p", "E_w", "falls"]
    noise = [row for row in cells if row[0].startswith("arms moved by noise: ")]
    assert "; ".join(row[0].partition(": ")[2] for row in noise) == (
        "paper, trained with noise; h1-noise; paper, trained with motions; h1-motion; "
        "paper, trained without intervention; h1-none; h1-plain"
    )
    assert noise[0][1:] == ["0.029", "0.066", "0.060", ""] and noise[4][1:4] == ["0.193", "0.405", "0.228"]
    assert [row[1] for row in noise[1::2]] == ["*0.050*", "*0.050*", "0.050"] and noise[6][1] == "*0.050*"
    assert len(cells) == 1 + 3 * 7
    feet = tool.lay_out(tool.TABLES["foot-displacement"], found)
    assert feet[0][1:3] == [f"foot displacement, h commanded{part} [m in 20 s]" for part in ("", ", creep in it")]
    assert [row[:3] for row in feet if row[0].startswith("arms moved by noise: ")][:2] == [
        ["arms moved by noise: paper, trained with noise", "0.034", ""],
        ["arms moved by noise: h1-noise", "0.020", "0.010"],
    ]


def test_tables_of_the_ablation_need_its_policies(tool, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(tool, "POLICIES", tmp_path)
    for policy in tool.ABLATION[:3]:
        (tmp_path / policy).mkdir()
        (tmp_path / policy / "policy.safetensors").touch()
    monkeypatch.setattr(sys, "argv", ["results.py", "--quick", "--only", "hands", "disturbance"])
    with pytest.raises(SystemExit, match=rf"^no policy\.safetensors in {tmp_path}/h1-plain;"):
        tool.main()
    tool.check_policies({name: tool.TABLES[name] for name in ("single-commands", "hands")})


def test_a_table_takes_the_place_of_the_last_one(tool) -> None:
    text = "Before.\n\n<!-- results: hands 0123 -->\n| old |\n<!-- end -->\n\nAfter.\n"
    written = tool.replaced(text, "hands", "| new |", "4567")
    assert written == "Before.\n\n<!-- results: hands 4567 -->\n| new |\n<!-- end -->\n\nAfter.\n"
    assert [part["commit"] for part in tool.marked(written)] == ["4567"]
    with pytest.raises(SystemExit, match="no place for the table feet"):
        tool.replaced(text, "feet", "", "")


def test_a_table_of_another_commit_or_of_other_commands_is_found(tool, monkeypatch, tmp_path, capsys) -> None:
    options = argparse.Namespace(public=None, policy=None, quick=False, seed=7)
    table = tool.Table(("page.md",), {"QP": "push --controller qp"})
    monkeypatch.setattr(tool, "ROOT", tmp_path)
    (tmp_path / "page.md").write_text("<!-- results: push 0123 -->\n<!-- end -->\n")
    body = tool.markdown([["", "falls"], ["QP", "0 of 3"]], tool.runs_of(table, options))
    (tmp_path / "page.md").write_text(tool.replaced((tmp_path / "page.md").read_text(), "push", body, "0123"))
    more = dataclasses.replace(table, runs={"QP": "push --controller qp --episodes 8"})
    for commit, each, said in (("0123", table, ""), ("4567", table, "of commit 0123"), ("0123", more, "--episodes 8")):
        monkeypatch.setattr(tool, "short_commit", lambda commit=commit: commit)
        assert tool.check({"push": each}, options) == bool(said)
        assert said in capsys.readouterr().out


def test_no_table_is_written_of_a_modified_tree(tool, monkeypatch) -> None:
    monkeypatch.setattr(tool, "short_commit", lambda: "0123456789ab+4567")
    monkeypatch.setattr(sys, "argv", ["results.py", "--only", "hands"])
    with pytest.raises(SystemExit, match=r"the source is 0123456789ab\+4567, changed since"):
        tool.main()


def test_every_run_is_a_command_that_a_user_may_give(tool) -> None:
    options = argparse.Namespace(public="my networks", policy=None, quick=True, seed=7)
    for table in tool.TABLES.values():
        for words in "; ".join(table.runs.values()).split("; "):
            run = tool.Run.of("", words, options)
            assert run.entry.settings.seed == 7 and run.entry.work > 0.0
            assert "my networks" not in run.words and ("FOLDER/" in run.words) == ("{public}" in words)


def test_tables_that_need_the_networks_of_others_are_not_left_out_silently(tool, monkeypatch) -> None:
    monkeypatch.setattr(sys, "argv", ["results.py", "--quick", "--only", "public", "whole-body"])
    with pytest.raises(SystemExit, match=r"^without --public FOLDER, .* networks, public, whole-body cannot run$"):
        tool.main()


@pytest.mark.parametrize(("words", "seed"), [([], 1100), (["--quick"], 0), (["--policy", "p"], 0)])
def test_what_is_looked_at_in_between_is_not_what_is_published(tool, monkeypatch, words, seed) -> None:
    class AskedError(Exception):
        pass

    def runs_of(table, options):
        raise AskedError(options.seed)

    monkeypatch.setattr(tool, "runs_of", runs_of)
    monkeypatch.setattr(tool, "short_commit", lambda: "0123")
    monkeypatch.setattr(sys, "argv", ["results.py", "--only", "hands", *words])
    with pytest.raises(AskedError, match=f"^{seed}$"):
        tool.main()


def test_a_command_that_both_controllers_run_is_given_once(tool) -> None:
    options = argparse.Namespace(public=None, policy=None, quick=False, seed=7)
    runs = [tool.Run.of("", f"push --controller {name}", options) for name in ("qp", "learned")]
    text = tool.markdown([["", "falls"], ["QP", "0 of 3"]], runs)
    assert text.endswith("| 0 of 3 |\n\n`hugwbc evaluate push --controller qp|learned --seed 7`")


def test_a_policy_that_is_not_shipped_has_the_tables_of_the_learned_controller(tool) -> None:
    options = argparse.Namespace(public=None, policy="my runs/policy.safetensors", quick=True, seed=7)
    parts = {name: tool.of_policy(table).runs for name, table in tool.TABLES.items()}
    assert not parts["public"] and not parts["g1"] and list(parts["comparison"]) == ["learned"]
    for words in parts["walking"].values():
        assert tool.Run.of("", words, options).entry.spec.policy == "my runs/policy.safetensors"
