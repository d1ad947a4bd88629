"""Where marks are, against places worked out by hand or by Pinocchio."""

import numpy as np
import pytest

from hugwbc import Gait, RobotState, load_robot
from hugwbc.kinematics import Kinematics
from hugwbc.runtime.trace import Snapshot
from hugwbc.sim.robot_model import load_model
from hugwbc.viz.marks import FORCE_SCALE, HAND_FORCE_SCALE, Marks, hull_edges, in_stance

ROBOT = load_robot()
QPOS = np.concatenate(([1.0, 2.0, ROBOT.nominal_height], [1.0, 0, 0, 0], ROBOT.nominal))


@pytest.fixture(scope="module")
def model():
    return load_model(0.002, robot=load_robot())


@pytest.fixture(scope="module")
def kinematics():
    kinematics = Kinematics(load_robot())
    kinematics.update(RobotState(QPOS[7:], np.zeros(19), QPOS[3:7], np.zeros(3), position=QPOS[:3]))
    return kinematics


def snapshot(**values):
    fields = {
        "qpos": QPOS, "gait": int(Gait.WALKING), "phase": 0.25, "foot_contact": np.array([True, True]),
        "foot_force": np.zeros((2, 3)), "pressure_centre": np.full((2, 3), np.nan), "foothold": np.full((2, 2), np.nan),
        "hand_target_world": np.full((2, 3), np.nan), "arm_target": np.full(8, np.nan),
    }  # fmt: skip
    return Snapshot(**{**fields, **values})


def tip(mark):
    """End of a mark of unit length along z."""
    w, x, y, z = mark.quaternion
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    return mark.position + mark.scale[2] * axis


def test_a_force_is_an_arrow_from_its_centre(model):
    force, point = np.array([[0, 0, 0], [-60.0, 80.0, 300.0]]), np.array([[np.nan] * 3, [1.1, 1.8, 0.0]])
    marks = Marks(model, load_robot()).at(snapshot(foot_force=force, pressure_centre=point))
    assert not marks["forces/left"].visible
    arrow = marks["forces/right"]
    assert arrow.visible
    np.testing.assert_allclose(arrow.position, point[1])
    np.testing.assert_allclose(tip(arrow), point[1] + FORCE_SCALE * force[1], atol=1e-9)


def test_the_balance_shows_the_centre_of_mass_above_the_support(model, kinematics):
    marks = Marks(model, load_robot()).at(snapshot())
    centre = kinematics.centre_of_mass()
    np.testing.assert_allclose(marks["balance/centre"].position, centre, atol=1e-6)
    np.testing.assert_allclose(tip(marks["balance/plumb"]), centre, atol=1e-6)
    np.testing.assert_allclose(marks["balance/ground"].position[:2], centre[:2], atol=1e-6)
    # Standing on both feet, the area's corners are both heels and both toes.
    edges = [marks[f"balance/edge_{i}"] for i in range(4)]
    corners = {tuple(np.round(edge.position[:2], 4).tolist()) for edge in edges}
    ends = [kinematics.position(f"{side}_{end}") for side in ("left", "right") for end in ("heel", "toe")]
    assert corners == {tuple(np.round(end[:2], 4).tolist()) for end in ends}


def test_on_one_foot_the_support_is_a_line_and_in_flight_there_is_none(model, kinematics):
    marks = Marks(model, load_robot()).at(snapshot(foot_contact=np.array([False, True])))
    line = marks["balance/edge_0"]
    ends = sorted([line.position[0], tip(line)[0]])
    assert ends == pytest.approx([kinematics.position("right_heel")[0], kinematics.position("right_toe")[0]], abs=1e-6)
    assert not any(marks[f"balance/edge_{i}"].visible for i in (1, 2, 3))
    marks = Marks(model, load_robot()).at(snapshot(foot_contact=np.array([False, False])))
    assert [name for name, mark in marks.items() if name.startswith("balance") and mark.visible] == ["balance/centre"]


def test_ghosts_show_the_arms_as_the_inverse_kinematics_wants_them(model, kinematics):
    assert not Marks(model, load_robot()).at(snapshot())["hands/ghost_left"].visible
    wanted = QPOS[7:][ROBOT.arms] + 0.3
    ghost = Marks(model, load_robot()).at(snapshot(arm_target=wanted))["hands/ghost_left"]
    q = QPOS[7:].copy()
    q[ROBOT.arms] = wanted
    other = Kinematics(load_robot())
    other.update(RobotState(q, np.zeros(19), QPOS[3:7], np.zeros(3), position=QPOS[:3]))
    np.testing.assert_allclose(ghost.position, other.position("left_elbow_link"), atol=1e-6)
    assert np.linalg.norm(ghost.position - kinematics.position("left_elbow_link")) > 0.05


def test_planned_steps_and_footprints_lie_on_the_ground(model):
    marks = Marks(model, load_robot())
    planned = marks.at(snapshot(foothold=np.array([[1.3, 2.1], [np.nan, np.nan]])))
    assert planned["steps/planned_left"].position[:2] == pytest.approx([1.3, 2.1])
    assert planned["steps/planned_left"].position[2] == pytest.approx(0.0, abs=0.003)
    assert not planned["steps/planned_right"].visible
    turned = QPOS.copy()
    turned[3:7] = np.cos(0.4), 0, 0, np.sin(0.4)
    np.testing.assert_allclose(marks.footprint(turned, 1).quaternion, turned[3:7], atol=1e-3)


def test_feet_have_the_colour_of_their_phase():
    contact = np.array([True, True])
    # Walking, the left foot is half a cycle ahead: at a phase of 0.25 it swings and the right one stands.
    np.testing.assert_array_equal(in_stance(0.25, Gait.WALKING, contact), [False, True])
    np.testing.assert_array_equal(in_stance(0.75, Gait.JUMPING, contact), [False, False])
    np.testing.assert_array_equal(in_stance(np.nan, Gait.WALKING, contact), [True, True])


def test_the_hull_is_convex_and_goes_round_once():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5]], dtype=float)
    assert sorted(hull_edges(square)) == [(0, 1), (1, 2), (2, 3), (3, 0)]
    assert hull_edges(np.array([[0.0, 0.0], [2.0, 0.0]])) == [(0, 1)]
    assert hull_edges(np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 0.0]])) == [(0, 1)]
    assert {0, 3} <= set(np.ravel(hull_edges(np.linspace([0.0, 0.0], [0.6, 0.3], 4)))), "feet on a line"


def test_a_force_on_a_hand_is_an_arrow_that_ends_at_the_hand(model, kinematics):
    marks = Marks(model, load_robot()).at(snapshot(hand_force=np.array([[-20.0, 10.0, 0.0], [0.0, 0.0, 0.5]])))
    hand = kinematics.position("left_hand")
    np.testing.assert_allclose(tip(marks["forces/left_hand"]), hand, atol=1e-5)
    np.testing.assert_allclose(
        marks["forces/left_hand"].position, hand - HAND_FORCE_SCALE * np.array([-20, 10, 0]), atol=1e-5
    )
    assert not marks["forces/right_hand"].visible  # less than 1 N
