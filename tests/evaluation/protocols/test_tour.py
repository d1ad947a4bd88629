import dataclasses
import json
import math

import numpy as np
import pytest

from hugwbc import Command, Gait, rotations
from hugwbc.errors import ConfigError
from hugwbc.evaluation.engine import Tour
from hugwbc.evaluation.protocols.episodes import Run
from hugwbc.evaluation.protocols.tour import (
    STRUCK,
    TourConfig,
    TourEpisode,
    TourJudge,
    TourProtocol,
    TourResult,
    blow_outcomes,
    strongest_blow,
    tour_plan,
)
from hugwbc.robot import load_robot
from hugwbc.runtime.controllers import HoldController
from hugwbc.sim import Disturber, Simulation

CONFIG = TourConfig(seed=5)


def test_a_tour_has_twelve_waypoints_and_a_blow_on_each_leg():
    plan, same, other = tour_plan(CONFIG, 1), tour_plan(CONFIG, 1), tour_plan(CONFIG, 2)
    assert plan == same != other and isinstance(plan.commands, Tour)
    json.dumps(dataclasses.asdict(plan))
    assert len(plan.commands.waypoints) == len(plan.forces) == 12 and plan.commands.leg == 5.0
    places = np.array([(0.0, 0.0), *((goal.x, goal.y) for goal in plan.commands.waypoints)])
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert lengths.min() >= 0.8 and lengths.max() <= 1.5
    assert strongest_blow(CONFIG) == pytest.approx(600.0 * load_robot().mass / 35.0, rel=1e-3)
    for index, force in enumerate(plan.forces):
        assert 5.0 * index <= force.start and force.start + 0.08 < 5.0 * (index + 1)
        assert math.hypot(*force.vector) <= strongest_blow(CONFIG) and force.duration == 0.08
    assert plan.conditions is not None and plan.conditions.intervention == "noise"


def test_every_link_that_may_be_struck_exists():
    blows = tuple(dataclasses.replace(tour_plan(CONFIG, 0).forces[0], link=link) for link in STRUCK)
    Disturber(Simulation(sensing="exact").link_names, blows)


def test_prescribed_errors_come_out(synthetic_trace):
    """At the end of each leg 0.3 m and 0.1 rad off, on the sixth 0.8 m; a fall in the ninth."""
    plan = tour_plan(CONFIG, 0)
    assert isinstance(plan.commands, Tour)
    trace = synthetic_trace(Command(gait=Gait.WALKING), duration=60.0)
    qpos = np.zeros((trace.time.size, 26))
    for index, goal in enumerate(plan.commands.waypoints):
        off = 0.8 if index == 5 else 0.3
        leg = slice(250 * index, 250 * (index + 1))
        qpos[leg, :2] = goal.x, goal.y + off
        qpos[leg, 3:7] = rotations.from_yaw_pitch_roll(goal.yaw + 0.1, 0.0, 0.0)
    trace = dataclasses.replace(trace, qpos=qpos)
    row = TourJudge()(0, Run(plan, trace, 0.1))
    assert blow_outcomes(row.blows, row.felled) == [True] * 12
    assert row.reached == 11 and row.yaw_error == pytest.approx(0.1)
    assert row.position_error == pytest.approx((11 * 0.3 + 0.8) / 12)
    fallen = dataclasses.replace(trace, fell=True, survived_s=42.0, time=trace.time[:2100], qpos=qpos[:2100])
    row = TourJudge()(0, Run(plan, fallen, 0.1))
    assert row.fell and row.reached == 7 and row.position_error == pytest.approx((7 * 0.3 + 0.8) / 8)
    dealt = sum(force.start < 42.0 for force in plan.forces)
    assert row.blows == dealt and blow_outcomes(0, False) == []
    for delay, felled in ((2.9, True), (3.1, False)):
        end = plan.forces[0].start + delay
        assert end < plan.forces[1].start, "the next blow is later"
        row = TourJudge()(0, Run(plan, dataclasses.replace(trace, fell=True, survived_s=end), 0.1))
        assert row.felled is felled and blow_outcomes(row.blows, row.felled) == [not felled]
    at_once = dataclasses.replace(trace, fell=True, survived_s=1.0, time=trace.time[:50], qpos=qpos[:50])
    assert TourJudge()(0, Run(plan, at_once, 0.1)).position_error is None


class Watching(HoldController):
    """Stands on stiff legs and remembers the commands."""

    commands: list[Command]

    def act(self, state, command, upper_body):
        self.commands.append(command)
        return super().act(state, command, upper_body)


def test_the_commands_follow_the_robot():
    controller = Watching()
    controller.commands = []
    result = TourProtocol().run(lambda: controller, TourConfig(episodes=1, duration=2.4, blow=0.0, settle=0.1))
    assert result.episodes == 1 and result.strongest_blow == 0.0 == result.blows and 0.0 <= result.reached < 1.0
    first_leg = controller.commands[:9]
    assert len({(c.v_x, c.v_y, c.omega) for c in first_leg}) > 1, "the baseline sways, and the command with it"


def test_bad_settings_are_refused():
    with pytest.raises(ConfigError, match="needs a gait that moves"):
        TourConfig(Gait.STANDING)
    with pytest.raises(ConfigError, match="give a finite force, 0 N for none"):
        TourConfig(blow=-1.0)


def test_the_reports_figures_of_tours():
    rows = [
        {
            "reached": 12,
            "survived_s": 60.0,
            "position_error": 0.2,
            "yaw_error": 0.1,
            "fell": False,
            "blows": 12,
            "felled": False,
        },
        {
            "reached": 3,
            "survived_s": 20.0,
            "position_error": 0.4,
            "yaw_error": None,
            "fell": True,
            "blows": 4,
            "felled": True,
        },
    ]
    figures = TourProtocol().figures("qp", {"gait": "walking", "rows": rows})
    assert [f.value for f in figures] == pytest.approx([50.0, 100.0 * 15 / 16, 62.5, 40.0, 0.3, 0.1])
    assert [f.higher_is_better for f in figures] == [True, True, True, True, False, False]


def test_tours_are_described_with_intervals(lines, walking):
    rows = tuple(
        TourEpisode(6, 0.125, None, 12 - 8 * fell, fell, fell, 60.0, 0) for fell in (False, False, False, True)
    )
    tour = TourResult(
        **{"strongest_blow": 885.4, "episodes": 4, "falls": 1, "completed": 0.75, "reached": 0.5, "blows": 40},
        **{"blows_survived": 0.975, "position_error": 0.125, "yaw_error": None, "survived_s": 51.25},
        **(walking | {"rows": rows}),
    )
    text = TourProtocol().describe(tour)
    assert lines(text)["tours completed [%]"] == ["75", "30 to 95"] and lines(text)["waypoints reached [%]"] == [
        "50",
        "50 to 50",
    ]
    assert lines(text)["of 40 blows survived [%]"] == ["98", "87 to 100"], "39 of them, by Wilson's interval"
    assert lines(text)["survived [s]"] == ["51.2 of 10", "60.0 to 60.0"] and "blows of up to 885 N" in text
