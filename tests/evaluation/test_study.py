"""Several controllers on the same episodes: who is compared with whom, over which of them."""

import dataclasses

import polars as pl
import pytest

from hugwbc import Command
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.episode import CountedSettings
from hugwbc.evaluation.experiment import Experiment, Result
from hugwbc.evaluation.figures import Figure, falls_figure
from hugwbc.evaluation.intervals import bootstrap_mean, bootstrap_rms, single, wilson_of
from hugwbc.evaluation.plans import Plan
from hugwbc.evaluation.store import Store
from hugwbc.evaluation.study import Entry, remarks, run_study
from hugwbc.runtime.controllers import ControllerSpec

HARD = (1.0, 5.0, 2.0, 8.0, 3.0, 1.0, 4.0, 9.0)


def plan(settings):
    return [Plan(draw, Command(w=0.01 * draw)) for draw in range(settings.episodes)]


def episode(controller, settings, plan):
    """A controller whose every episode takes its number of letters longer, and which falls in the first ones."""
    letters = len(controller.name)
    fell = plan.draw < letters - 4
    return {"time": None if fell else HARD[plan.draw] + letters, "error": 0.1 * letters * HARD[plan.draw], "fell": fell}


def figures(settings, rows):
    return [
        Figure("T", "time", "s", bootstrap_mean(rows["time"])),
        Figure("T", "error, RMS", "m", bootstrap_rms(rows["error"])),
        Figure("T", "time of the upright", "s", bootstrap_mean(rows.filter(~pl.col("fell"))["time"])),
        Figure("T", "worst", "m", single(rows["error"].max())),
        falls_figure("T", rows["fell"]),
    ]


MINE = Experiment("mine", "", CountedSettings, plan, episode, figures)
NAMED = """
from hugwbc.runtime.controllers import HoldController


class Long(HoldController):
    name = "longer"
"""


@pytest.fixture
def longer(tmp_path):
    (tmp_path / "mine.py").write_text(NAMED)
    return ControllerSpec(f"{tmp_path / 'mine.py'}:Long")


def study(longer, episodes):
    settings = CountedSettings(episodes=episodes)
    results = run_study([Entry(MINE, settings, spec) for spec in (ControllerSpec("hold"), longer)])
    return results, {figure.quantity: figure.difference for figure in results[1].figures}


def test_differences_are_over_the_episodes_that_both_have(longer):
    results, found = study(longer, 8)
    assert [result.controller for result in results] == ["hold", "longer"], "by its own name"
    assert all(figure.difference is None for figure in results[0].figures)
    for name in ("time", "time of the upright"):  # the second fell in the first two episodes
        difference = found[name].estimate
        assert (difference.value, difference.low, difference.high) == pytest.approx((2.0, 2.0, 2.0))
        assert difference.samples == 6 and found[name].against == "hold"
    rms = (sum(hard**2 for hard in HARD) / 8) ** 0.5
    assert found["error, RMS"].estimate.value == pytest.approx(0.2 * rms) and not found["error, RMS"].is_clear
    assert dataclasses.replace(found["error, RMS"], judged=True).is_clear, "but for the falls of the second"
    assert found["falls"].estimate.value == pytest.approx(25.0) and found["falls"].p == 0.5
    assert found["worst"] is None, "no mean of episodes"
    assert not remarks([dataclasses.replace(results[0])])


def test_what_happened_with_one_controller_alone_is_zero_with_the_other(longer):
    def with_reasons(settings, rows):
        late = int((rows["time"].fill_null(0.0) > 14.5).sum())
        reasons = [Figure("T", "late", "% of episodes", wilson_of(late, len(rows)))] if late else []
        return [falls_figure("T", rows["fell"]), *reasons]

    experiment, settings = dataclasses.replace(MINE, figures=with_reasons), CountedSettings(episodes=8)
    found = run_study([Entry(experiment, settings, spec) for spec in (longer, ControllerSpec("hold"))])
    late, never = (next(figure for figure in result.figures if figure.quantity == "late") for result in found)
    assert late.value == 12.5 and (never.value, never.estimate.samples, never.controller) == (0.0, 8, "hold")
    assert never.difference.estimate.value == -12.5 and never.difference.p == 1.0


def test_too_few_episodes_are_said(longer):
    results, found = study(longer, 4)
    lost, few, tested = remarks(results)
    assert lost == "mine, longer: 2 of 4 episodes fell and lack values that others have; means are without these."
    assert "time, error, RMS, time of the upright rest on 2 or more each; below 8" in few
    assert "4 pairs cannot be told apart" in tested and not found["error, RMS"].is_clear


def test_what_a_fall_never_has_is_not_lost():
    def said(**values):
        """Return the remarks on a fall with noise that has no value of the arms, beside other episodes."""
        found = [("noise", {"arms": 0.1}), ("noise", {"fell": True}), ("none", {"fell": True}), ("none", values)]
        plans = [Plan(draw, tags={"case": case}) for draw, (case, _) in enumerate(found)]
        rows = [{"arms": None, "touch": None, "fell": False} | row for _, row in found]
        return remarks([Result("mine", "hold", CountedSettings(), plans, rows, [])])

    assert said() == said(fell=True, touch=0.4)
    assert said()[0].startswith("mine, hold: 1 of 4 episodes fell") and "2 of 4" in said(arms=0.1)[0]


def test_another_setting_is_not_compared():
    settings = [CountedSettings(episodes=3, seed=seed) for seed in (1, 2)]
    results = run_study([Entry(MINE, one, ControllerSpec("hold")) for one in settings])
    assert not any(figure.difference for result in results for figure in result.figures)


def test_a_told_robot_that_nobody_hears_is_refused():
    def run(controller, **conditions):
        settings = CountedSettings(conditions=Conditions(told="h1-2023", **conditions))
        return run_study([Entry(MINE, settings, ControllerSpec(controller))])

    with pytest.raises(ConfigError, match="learned takes no robot; leave out --told or --sensing"):
        run("learned", sensing="exact")
    assert run("learned") and run("qp", sensing="exact")


def test_what_is_stored_is_said_at_once_and_counts_as_done(longer, tmp_path):
    entries = [Entry(MINE, CountedSettings(episodes=4), spec) for spec in (ControllerSpec("hold"), longer)]
    said, parts = [], []
    for chosen in (entries[:1], entries, entries):
        parts.append([])
        run_study(chosen, store=Store(tmp_path), on_progress=parts[-1].append, tell=said.append)
    assert said == ["4 of 8 episodes are stored", "all 8 episodes are stored"]
    assert parts[1][0] == 0.5 and parts[1][-1] == 1.0 and set(parts[2]) == {1.0}
    more = [Entry(MINE, CountedSettings(episodes=6), ControllerSpec("hold"))]
    assert len(run_study(more, store=Store(tmp_path), tell=said.append)[0].rows) == 6
    assert said[-1] == "4 of 6 episodes are stored"
