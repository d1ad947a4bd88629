import dataclasses
import math

import pytest
import torch

from hugwbc.gait import Gait
from hugwbc.learned.config import EnvConfig, ExtraWeights, RewardWeights
from hugwbc.learned.env import rewards
from hugwbc.learned.env.readings import Body, Transition
from hugwbc.robot import load_robot

ROBOT = load_robot()
BODY = Body.of(ROBOT, 0.02)


def make_transition(**changes: torch.Tensor) -> Transition:
    """One robot at rest in the nominal pose, both feet in expected and actual stance."""
    fields = {
        "command": torch.tensor([[0.0, 0.0, 0.0, 2.0, 0.15, 0.0, 0.0, 0.0]]),
        "gait": torch.tensor([int(Gait.WALKING)]),
        **dict.fromkeys(("yaw_rate", "height", "pitch", "roll"), torch.zeros(1)),
        **dict.fromkeys(("bias", "velocity", "angular_velocity"), torch.zeros(1, 3)),
        **dict.fromkeys(("gravity", "position", "heading", "link_force"), torch.zeros(1)),  # no reward reads them
        "q": torch.tensor(ROBOT.nominal, dtype=torch.float32)[None],
        **dict.fromkeys(("dq", "previous_dq", "torque"), torch.zeros(1, 19)),
        **dict.fromkeys(("action", "previous_action", "older_action"), torch.zeros(1, 19)),
        **dict.fromkeys(("clearance", "target_clearance", "descent", "bounce"), torch.zeros(1, 2)),
        "foot_velocity": torch.zeros(1, 2, 3),
        "foot_force": torch.tensor([[[0.0, 0.0, 250.0], [0.0, 0.0, 250.0]]]),
        "touch_down": torch.zeros(1, 2, dtype=torch.bool),
        "foot_offset": torch.tensor([[0.0, 0.4, 0.0]]),
        "contact": torch.ones(1, 2),
        "in_phase": torch.tensor([True]),
        **dict.fromkeys(("intervention", "fallen"), torch.tensor([False])),
    }
    return Transition(**{**fields, **changes})


def with_joint(name: str, value: float) -> torch.Tensor:
    q = torch.zeros(1, 19)
    q[0, ROBOT.index(name)] = value
    return q


CASES = {
    "linear_velocity_tracking": ({"velocity": torch.tensor([[0.3, -0.4, 9.0]])}, math.exp(-0.25 / 0.2)),
    "angular_velocity_tracking": ({"yaw_rate": torch.tensor([0.5])}, math.exp(-0.25 / 0.2)),
    "body_height_tracking": ({"height": torch.tensor([-0.1])}, 0.01),
    "body_pitch_tracking": ({"pitch": torch.tensor([0.3])}, 0.09),
    "waist_yaw_tracking": ({"q": with_joint("torso_joint", 0.2)}, 0.04),
    # Left foot in the middle of swing, 5 cm too low.
    "foot_swing_tracking": (
        {
            "contact": torch.tensor([[0.0, 1.0]]),
            "target_clearance": torch.tensor([[0.15, 0.0]]),
            "clearance": torch.tensor([[0.10, 0.03]]),
        },
        0.0025,
    ),
    # Left foot should swing but carries 5 N; right foot should stand but slides at 1 m/s.
    "contact_swing_tracking": (
        {
            "contact": torch.tensor([[0.0, 1.0]]),
            "foot_force": torch.tensor([[[3.0, 0.0, 4.0], [0.0, 0.0, 500.0]]]),
            "foot_velocity": torch.tensor([[[2.0, 0.0, 0.0], [0.6, 0.8, 3.0]]]),
        },
        (1 - math.exp(-25 / 50)) + (1 - math.exp(-1 / 5)),
    ),
    "roll_pitch_angular_velocity": ({"angular_velocity": torch.tensor([[0.3, 0.4, 5.0]])}, 0.25),
    "vertical_body_movement": ({"velocity": torch.tensor([[1.0, 1.0, 0.2]])}, 0.04),
    # Left foot in the air: its speed does not count.
    "feet_slip": (
        {
            "foot_force": torch.tensor([[[0.0, 0.0, 0.0], [0.0, 0.0, 400.0]]]),
            "foot_velocity": torch.tensor([[[3.0, 0.0, 0.0], [0.0, 0.5, 0.0]]]),
        },
        1 - math.exp(-0.25),
    ),
    "action_rate": ({"action": torch.full((1, 19), 0.5), "previous_action": torch.full((1, 19), 0.3)}, 19 * 0.04),
    "action_smoothness": (
        {
            "action": torch.full((1, 19), 0.5),
            "previous_action": torch.full((1, 19), 0.3),
            "older_action": torch.full((1, 19), 0.0),
        },
        19 * 0.01,
    ),
    "joint_torque": ({"torque": torch.full((1, 19), 10.0)}, 1900.0),
    "joint_acceleration": ({"dq": torch.full((1, 19), 0.2)}, 19 * 100.0),
    "upper_joint_deviation": ({"q": with_joint("left_elbow_joint", 0.5)}, 0.25),
    # Both hip rolls are 0.02 rad away from their nominal +-0.02.
    "hip_joint_deviation": ({"q": torch.zeros(1, 19)}, 2 * 0.02**2),
    "feet_symmetry": ({"foot_offset": torch.tensor([[0.3, 0.4, 0.1]])}, 0.10),
    "termination": ({"fallen": torch.tensor([True])}, 1.0),
    "alive": ({}, 1.0),
    "body_roll_tracking": ({"roll": torch.tensor([-0.2])}, 0.04),
    # Knee range is -0.26 to 2.05: 95 % of the half range ends at 1.99225.
    "joint_limits": ({"q": with_joint("left_knee_joint", 2.05)}, 2.05 - (0.895 + 0.95 * 1.155)),
    "linear_velocity_precision": ({"velocity": torch.tensor([[0.3, -0.4, 9.0]])}, math.exp(-2.0)),
    "linear_velocity_error": ({"velocity": torch.tensor([[0.3, -0.4, 9.0]])}, 0.25),
    "yaw_rate_precision": ({"yaw_rate": torch.tensor([-0.25])}, math.exp(-1.0)),
    "yaw_rate_error": ({"yaw_rate": torch.tensor([-0.5])}, 0.25),
    "posture_precision": (
        {"height": torch.tensor([0.1]), "pitch": torch.tensor([-0.2])},
        (math.exp(-1.0) + math.exp(-2.0) + 1.0) / 3.0,
    ),
    "swing_precision": (
        {"contact": torch.tensor([[1.0, 0.25]]), "clearance": torch.tensor([[0.3, 0.1]])},
        0.75 * math.exp(-2.0),
    ),
    "velocity_bias": ({"bias": torch.tensor([[0.3, -0.4, 9.0]])}, 0.5),
    "yaw_rate_bias": ({"bias": torch.tensor([[9.0, 9.0, -0.2]])}, 0.2),
    # The left sole comes down at 0.8 m/s; the right one is still in the air.
    "foot_impact": ({"touch_down": torch.tensor([[True, False]]), "descent": torch.tensor([[0.8, 2.0]])}, 0.25),
    # The left foot should stand and is in the air; the right one should swing with 0.8 and is on the ground.
    "contact_mismatch": (
        {"contact": torch.tensor([[1.0, 0.2]]), "foot_force": torch.tensor([[[0.0, 0.0, 0.0], [0.0, 0.0, 400.0]]])},
        1.8,
    ),
    "flight_contact": ({"contact": torch.tensor([[1.0, 0.2]]), "gait": torch.tensor([int(Gait.JUMPING)])}, 0.8),
    "bounce_tracking": (
        {"gait": torch.tensor([int(Gait.JUMPING)]), "bounce": torch.tensor([[0.0, 1.2]]), "velocity": torch.ones(1, 3)},
        math.exp(-0.04 / 0.2),
    ),
    "bounce_error": ({"gait": torch.tensor([int(Gait.JUMPING)]), "bounce": torch.tensor([[0.0, 1.0]])}, 1.0),
    "unequal_support": ({"foot_force": torch.tensor([[[0.0, 0.0, 3.0], [0.0, 4.0, 4.0]]])}, 1.0),
}


IN_TURN = torch.tensor([False])
ONE_FOOT = torch.tensor([[[0.0, 0.0, 0.0], [0.0, 0.0, 400.0]]])
LANDING = {"touch_down": torch.tensor([[True, False]]), "descent": torch.tensor([[1.6, 0.0]])}
UP = {"bounce": torch.tensor([[0.0, 1.2]]), "velocity": torch.ones(1, 3), "foot_force": ONE_FOOT}  # the left foot
MORE = [
    ("bounce_tracking", {"gait": torch.tensor([int(Gait.HOPPING_RIGHT)]), **UP}, math.exp(-0.04 / 0.2)),
    ("bounce_tracking", {"gait": torch.tensor([int(Gait.HOPPING_LEFT)]), **UP}, 0.0),
    # Two feet count in phase alone, and the support of one foot alone.
    ("feet_symmetry", {"foot_offset": torch.tensor([[0.3, 0.4, 0.1]]), "in_phase": IN_TURN}, 0.0),
    ("unequal_support", {"foot_force": ONE_FOOT, "in_phase": IN_TURN}, 0.0),
    *(("unequal_support", {"foot_force": torch.full((1, 2, 3), both)}, 0.0) for both in (0.0, 400.0)),
    # A flight may end as fast as the clock's free fall, which a robot that still rises at the touch-down does not have.
    ("foot_impact", LANDING, 1.69),
    ("foot_impact", {"bounce": torch.tensor([[0.0, -0.8]]), **LANDING}, 0.25),
    ("foot_impact", {"bounce": torch.tensor([[0.0, -1.5]]), **LANDING}, 0.0),
    ("foot_impact", {"bounce": torch.tensor([[0.0, 0.8]]), **LANDING}, 1.69),
    # A soft landing costs nothing, and a hard one no more than its limit.
    ("foot_impact", {"touch_down": torch.tensor([[True, True]]), "descent": torch.tensor([[0.3, -1.0]])}, 0.0),
    ("foot_impact", {"touch_down": torch.tensor([[True, True]]), "descent": torch.tensor([[5.0, 0.0]])}, 4.0),
]


@pytest.mark.parametrize(("name", "changes", "expected"), [*((name, *CASES[name]) for name in sorted(CASES)), *MORE])
def test_row_against_hand_computed_value(name: str, changes: dict, expected: float) -> None:
    term = rewards.TERMS[name]
    assert term(make_transition(**changes), BODY).item() == pytest.approx(expected, rel=1e-5)


def test_every_term_has_a_case() -> None:
    assert set(CASES) == set(rewards.TERMS)


def test_weights_are_the_paper_s() -> None:
    assert list(dataclasses.asdict(RewardWeights()).values()) == [
        2, 2, -40, -10, -2, -30, -2, -0.5, -0.1, -0.2, -0.01, -0.01, -5e-6, -2.5e-7, -0.5, -2, -5, -200,
    ]  # fmt: skip


MASKED = {
    "action_rate": "action",
    "action_smoothness": "action",
    "joint_torque": "torque",
    "joint_acceleration": "dq",
    "upper_joint_deviation": "q",
}


@pytest.mark.parametrize("name", MASKED)
def test_intervention_masks_the_arms_only(name: str) -> None:
    arms = torch.zeros(1, 19)
    arms[0, ROBOT.arms] = 1.0
    legs = 1.0 - arms
    term = rewards.TERMS[name]
    field = MASKED[name]
    masked = {"intervention": torch.tensor([True])}
    assert term(make_transition(**{field: arms}, **masked), BODY).item() == 0.0
    assert term(make_transition(**{field: arms}), BODY).item() > 0.0
    if field != "q":
        assert term(make_transition(**{field: legs}, **masked), BODY).item() > 0.0


def test_terms_are_weighted_by_period_and_penalty_scale() -> None:
    transition = make_transition(height=torch.tensor([0.1]), angular_velocity=torch.tensor([[1.0, 0.0, 0.0]]))
    terms = rewards.reward_terms(EnvConfig(extra=ExtraWeights(alive=0.0)))
    values = rewards.evaluate_terms(terms, transition, BODY, penalty_scale=0.2)
    assert "alive" not in values and set(values) > {"body_height_tracking", "roll_pitch_angular_velocity"}
    assert values["body_height_tracking"].item() == pytest.approx(-40 * 0.02 * 0.01)
    assert values["roll_pitch_angular_velocity"].item() == pytest.approx(-0.5 * 0.02 * 0.2)


def test_the_penalty_scale_is_on_the_rows_of_the_papers_regularisation_but_termination() -> None:
    own = {"joint_limits", "velocity_bias", "yaw_rate_bias", "foot_impact", "contact_mismatch", "flight_contact"}
    assert own < rewards.REGULARISATION and own <= {field.name for field in dataclasses.fields(ExtraWeights)}
    assert rewards.REGULARISATION - own == {
        "roll_pitch_angular_velocity", "vertical_body_movement", "feet_slip", "action_rate", "action_smoothness",
        "joint_torque", "joint_acceleration", "upper_joint_deviation", "hip_joint_deviation", "feet_symmetry",
    }  # fmt: skip


def test_contacts_in_flight_count_in_jumping_and_hopping_and_no_mismatch_does_in_standing() -> None:
    lifted = {"contact": torch.tensor([[0.0, 0.0]])}
    for gait in (Gait.STANDING, Gait.WALKING, Gait.JUMPING, Gait.HOPPING_RIGHT):
        transition = make_transition(gait=torch.tensor([int(gait)]), **lifted)
        assert (rewards.flight_contact(transition, BODY).item() == 2.0) == (gait in (Gait.JUMPING, Gait.HOPPING_RIGHT))
        assert (rewards.contact_mismatch(transition, BODY).item() == 0.0) == (gait is Gait.STANDING)
