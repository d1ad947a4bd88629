import pytest

from hugwbc import Gait
from hugwbc.cli import descriptions
from hugwbc.evaluation import protocols
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.protocols.disturbance import DIRECTIONS
from hugwbc.evaluation.protocols.heatmap import OrthogonalRange
from hugwbc.evaluation.protocols.robustness import RobustnessLevel
from hugwbc.evaluation.protocols.tour import TourEpisode

STANDING = {
    **{"controller": "qp", "gait": "standing", "seed": 0, "duration": 10.0, "settle": 1.0},
    **{"conditions": Conditions(), "rows": ()},
}
WALKING = {**STANDING, "gait": "walking"}
KINDS = ("none", "noise", "motion")


def lines(text: str) -> dict[str, list[str]]:
    """The words after each line's first cell, which ends where two spaces begin."""
    cells = [[cell for cell in line.split("  ") if cell.strip()] for line in text.splitlines()]
    return {line[0].strip(): [cell.strip() for cell in line[1:]] for line in cells if line}


def test_interventions_stand_beside_the_paper():
    result = protocols.InterventionResult(
        training="noise",
        episodes=3,
        falls={"none": 0, "noise": 1, "motion": 0},
        errors={kind: {"E_h": 0.05, "E_p": None} for kind in KINDS},
        arm_error={"none": None, "noise": 0.125, "motion": 0.2},
        paper={"none": {"E_h": 0.1, "E_p": 0.2}, "noise": {"E_h": 0.025}, "motion": {}},
        **STANDING,
    )
    none, noise, motion = descriptions.describe_intervention(result).split("arms: ")[1:]
    assert lines(none)["E_h"] == ["0.0500", "0.1000", "0.500"] and lines(none)["E_p"] == ["-", "0.2000", "-"]
    assert lines(noise)["E_h"][-1] == "2.000" and lines(motion)["E_h"] == ["0.0500", "-", "-"]
    assert "falls: 1 of 3 episodes; arm joints 0.125 rad" in noise and "arm joints" not in none


def test_foot_displacement_says_what_is_creep():
    table = {kind: {"h": 0.02, "p": None} for kind in KINDS}
    result = protocols.FootDisplacementResult(
        training="noise",
        episodes=2,
        falls=dict.fromkeys(KINDS, 1),
        displacement=table,
        creep={kind: {"h": 0.015, "p": None} for kind in KINDS},
        paper={kind: {"h": 0.01, "p": 0.1} for kind in KINDS},
        **STANDING,
    )
    text = descriptions.describe_foot_displacement(result)
    assert lines(text)["noise, h"] == ["0.0200", "0.0100", "2.000", "0.0150"]
    assert lines(text)["noise, p"] == ["-", "0.1000", "-", "-"], "nobody was upright to creep"
    assert "in 9 s; falls: none 1 of 2, noise 1 of 2" in text


@pytest.mark.parametrize("refused", [80.0, None])
def test_forces_are_listed_by_direction(refused):
    forces = {
        kind: {str(d): factor * 10.0 + d for d in DIRECTIONS} for kind, factor in (("constant", 1), ("second", 2))
    }
    result = protocols.DisturbanceResult(
        rollouts=16,
        tolerated=forces,
        refused={"constant": {"0": refused}, "second": {}},
        episodes=500,
        **STANDING,
    )
    text = descriptions.describe_disturbance(result)
    assert lines(text)["90 deg, left"] == ["100", "110"] and lines(text)["45 deg"] == ["55", "65"]
    assert "16 rollouts; 500 rollouts in all" in text and ("limit of the search" in text) == (refused is None)


def test_orthogonal_ranges_stand_where_row_and_column_meet():
    ranges = (OrthogonalRange("h", "p", 0.0, 0.2, 0.5, 2.0), OrthogonalRange("p", "h", None, None, 0.0, None))
    values = {"h": [-0.3, 0.0], "p": [0.0, 0.4]}
    single = {"h": 0.01, "p": None}
    result = protocols.HeatmapResult(
        points=2, values=values, single=single, maps=(), orthogonality=ranges, episodes=8, falls=1, **STANDING
    )
    found = lines(descriptions.describe_heatmap(result))
    assert found["h"] == ["0.010", "0 to 0.2"] and found["p"] == ["-", "-"]


def test_robustness_names_factor_value_and_unit():
    levels = [("nominal", 0.0, 1.0), ("terrain_roughness", 0.02, 1.5), ("gain", 0.9, None)]
    result = protocols.RobustnessResult(
        samples=8, levels=tuple(RobustnessLevel(f, v, 1, 8, {}, ratio) for f, v, ratio in levels), **WALKING
    )
    found = lines(descriptions.describe_robustness(result))
    assert found["nominal"] == ["1 of 8", "1.000"]
    assert found["roughness 0.02 m"] == ["1 of 8", "1.500"] and found["gain 0.9"] == ["1 of 8", "-"]


def test_ramps_tours_and_efforts():
    errors, paper = {"E_p": 0.05, "E_w": None}, {"E_p": 0.1, "E_w": 0.2}
    ramp = protocols.RampResult(episodes=5, falls={"p": 1, "w": 0}, errors=errors, paper=paper, **WALKING)
    text = descriptions.describe_ramp(ramp)
    assert lines(text)["E_p"] == ["0.0500", "0.1000", "0.500"] and "falls: p 1 of 5, w 0 of 5 runs" in text
    rows = tuple(
        TourEpisode(6, 0.125, None, 12 - 8 * fell, fell, fell, 60.0, 0) for fell in (False, False, False, True)
    )
    tour = protocols.TourResult(
        **{"strongest_blow": 885.4, "episodes": 4, "falls": 1, "completed": 0.75, "reached": 0.5, "blows": 40},
        **{"blows_survived": 0.975, "position_error": 0.125, "yaw_error": None, "survived_s": 51.25},
        **(WALKING | {"rows": rows}),
    )
    text = descriptions.describe_tour(tour)
    assert lines(text)["tours completed [%]"] == ["75 [30, 95]"] and lines(text)["waypoints reached [%]"] == ["50"]
    assert lines(text)["of 40 blows survived [%]"] == ["98 [87, 100]"], "39 of them, by Wilson's interval"
    assert lines(text)["survived [s]"] == ["51.2 of 10"] and "blows of up to 885 N" in text
    from hugwbc.runtime.controllers import HoldController

    effort = protocols.run_effort(HoldController, protocols.EffortConfig(Gait.WALKING, duration=0.2, settle=0.1))
    text = descriptions.describe_effort(effort)
    assert lines(text)["walking, hold"] == ["0 m/s", "0.25 m/s", "0.5 m/s", "1 m/s", "1.5 m/s"]
    assert lines(text)["cost of transport"] == ["-"] * 5 and lines(text)["fell"] == ["no"] * 5
