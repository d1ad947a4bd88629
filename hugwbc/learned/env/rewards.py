"""The paper's reward table, one pure function per row; with the terms that it lacks, weighted and by name.

Every function maps a `Transition` to one number per robot, shape (n,); weights are in `hugwbc.learned.config`. The
function's name is the row's; the docstring has the formula and says what was corrected. Terms of our own are in
`hugwbc.learned.env.extra_rewards`.
"""

import torch

from hugwbc.commands import COMMAND_NAMES
from hugwbc.learned.env.extra_rewards import EXTRA_TERMS
from hugwbc.learned.env.readings import feet_on_ground
from hugwbc.learned.env.transition import Body, Term, Transition

TRACKING_SIGMA = 0.2
CONTACT_FORCE_SIGMA = 50.0  # [N^2]
CONTACT_VELOCITY_SIGMA = 5.0  # [m^2/s^2]; the paper prints the name of the force's constant twice
_OMEGA, _H, _P, _W = (COMMAND_NAMES.index(name) for name in ("omega", "h", "p", "w"))


def linear_velocity_tracking(t: Transition, body: Body) -> torch.Tensor:
    """exp(-|v_xy_target - v_xy|^2 / 0.2)."""
    return torch.exp(-(t.command[:, :2] - t.velocity[:, :2]).square().sum(1) / TRACKING_SIGMA)


def angular_velocity_tracking(t: Transition, body: Body) -> torch.Tensor:
    """exp(-(omega_target - omega_z)^2 / 0.2)."""
    return torch.exp(-(t.command[:, _OMEGA] - t.yaw_rate).square() / TRACKING_SIGMA)


def body_height_tracking(t: Transition, body: Body) -> torch.Tensor:
    """(h_target - h)^2."""
    return (t.command[:, _H] - t.height).square()


def body_pitch_tracking(t: Transition, body: Body) -> torch.Tensor:
    """(p_target - p)^2."""
    return (t.command[:, _P] - t.pitch).square()


def waist_yaw_tracking(t: Transition, body: Body) -> torch.Tensor:
    """(w_target - w)^2."""
    return (t.command[:, _W] - t.q[:, body.waist]).square()


def foot_swing_tracking(t: Transition, body: Body) -> torch.Tensor:
    """sum_i (1 - C_i) (l_target_i - l_i)^2, with the corrected quintic profile."""
    return ((1.0 - t.contact) * (t.target_clearance - t.clearance).square()).sum(1)


def contact_swing_tracking(t: Transition, body: Body) -> torch.Tensor:
    """sum_i (1 - C_i) (1 - exp(-|f_i|^2 / 50)) + C_i (1 - exp(-|v_xy_i|^2 / 5)).

    Corrected: the paper prints positive exponents and a leading minus; the two sign errors cancel in direction, but
    the printed form is unbounded.
    """
    force = 1.0 - torch.exp(-t.foot_force.square().sum(2) / CONTACT_FORCE_SIGMA)
    speed = 1.0 - torch.exp(-t.foot_velocity[..., :2].square().sum(2) / CONTACT_VELOCITY_SIGMA)
    return ((1.0 - t.contact) * force + t.contact * speed).sum(1)


def roll_pitch_angular_velocity(t: Transition, body: Body) -> torch.Tensor:
    """|omega_xy|^2."""
    return t.angular_velocity[:, :2].square().sum(1)


def vertical_body_movement(t: Transition, body: Body) -> torch.Tensor:
    """v_z^2."""
    return t.velocity[:, 2].square()


def feet_slip(t: Transition, body: Body) -> torch.Tensor:
    """Sum over feet on the ground of 1 - exp(-|v_xy_i|^2).

    Corrected: the printed 1 - sum_i exp(-v_i^2) rewards rest with a bonus and also judges the swing foot.
    """
    return (feet_on_ground(t.foot_force) * (1.0 - torch.exp(-t.foot_velocity[..., :2].square().sum(2)))).sum(1)


def _upper_mask(t: Transition, body: Body) -> torch.Tensor:
    """1 for every joint that the policy drives: the paper masks the upper body's regularisation while I = 1."""
    mask = torch.ones_like(t.action)
    mask[:, body.arms] = (~t.intervention).to(mask.dtype)[:, None]
    return mask


def action_rate(t: Transition, body: Body) -> torch.Tensor:
    """|a_t - a_{t-1}|^2, without the arms under intervention."""
    return (_upper_mask(t, body) * (t.action - t.previous_action).square()).sum(1)


def action_smoothness(t: Transition, body: Body) -> torch.Tensor:
    """|a_{t-2} - 2 a_{t-1} + a_t|^2, without the arms under intervention."""
    return (_upper_mask(t, body) * (t.older_action - 2.0 * t.previous_action + t.action).square()).sum(1)


def joint_torque(t: Transition, body: Body) -> torch.Tensor:
    """|tau|^2, without the arms under intervention."""
    return (_upper_mask(t, body) * t.torque.square()).sum(1)


def joint_acceleration(t: Transition, body: Body) -> torch.Tensor:
    """|ddq|^2 from the velocities one control step apart, without the arms under intervention."""
    return (_upper_mask(t, body) * ((t.dq - t.previous_dq) / body.dt).square()).sum(1)


def upper_joint_deviation(t: Transition, body: Body) -> torch.Tensor:
    """|q_upper - q_upper_nominal|^2, masked while I = 1."""
    deviation = (t.q - body.nominal)[:, body.arms].square().sum(1)
    return deviation * ~t.intervention


def hip_joint_deviation(t: Transition, body: Body) -> torch.Tensor:
    """Squared deviation of hip yaw and hip roll from nominal (the paper's hip x and z)."""
    return (t.q - body.nominal)[:, body.hips].square().sum(1)


def feet_symmetry(t: Transition, body: Body) -> torch.Tensor:
    """1[bar phi_1 = bar phi_2] |p_xz of foot 0 - p_xz of foot 1|^2, in the heading frame."""
    return t.in_phase * (t.foot_offset[:, 0].square() + t.foot_offset[:, 2].square())


def termination(t: Transition, body: Body) -> torch.Tensor:
    """1 at an early termination."""
    return t.fallen.to(t.command.dtype)


PAPER_TERMS: dict[str, Term] = {
    term.__name__: term
    for term in (
        linear_velocity_tracking,
        angular_velocity_tracking,
        body_height_tracking,
        body_pitch_tracking,
        waist_yaw_tracking,
        foot_swing_tracking,
        contact_swing_tracking,
        roll_pitch_angular_velocity,
        vertical_body_movement,
        feet_slip,
        action_rate,
        action_smoothness,
        joint_torque,
        joint_acceleration,
        upper_joint_deviation,
        hip_joint_deviation,
        feet_symmetry,
        termination,
    )
}
# The paper's regularisation group: grows with the penalty curriculum. Termination does not.
REGULARISATION = frozenset(PAPER_TERMS) - {
    "linear_velocity_tracking",
    "angular_velocity_tracking",
    "body_height_tracking",
    "body_pitch_tracking",
    "waist_yaw_tracking",
    "foot_swing_tracking",
    "contact_swing_tracking",
    "termination",
} | {"joint_limits"}


def evaluate_terms(
    transition: Transition, body: Body, weights: dict[str, float], penalty_scale: float
) -> dict[str, torch.Tensor]:
    """Weighted rewards of one control step, by term; terms of weight zero are left out.

    Args:
        transition: the step.
        body: the robot's constants.
        weights: by term name, paper's and extra.
        penalty_scale: the curriculum's factor on the regularisation group.

    Returns:
        Term to shape (n,), already multiplied by the control period.
    """
    terms = PAPER_TERMS | EXTRA_TERMS
    rewards = {}
    for name, weight in weights.items():
        if weight != 0.0:
            scale = penalty_scale if name in REGULARISATION else 1.0
            rewards[name] = weight * scale * body.dt * terms[name](transition, body)
    return rewards


def relative_tracking(rewards: dict[str, torch.Tensor], weights: dict[str, float], dt: float) -> torch.Tensor:
    """Linear and angular tracking reward relative to their maxima, for the curricula, shape (n, 2).

    Args:
        rewards: what `evaluate_terms` gave.
        weights: that it was given.
        dt: control period [s].
    """
    names = (linear_velocity_tracking.__name__, angular_velocity_tracking.__name__)
    return torch.stack([rewards[name] / (weights[name] * dt) for name in names], dim=1)
