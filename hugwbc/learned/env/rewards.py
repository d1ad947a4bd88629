"""The rewards: the rows of the paper's table, then the terms that it lacks, one pure function each.

A function maps a `Transition` and the constants of the `Body` to one number per robot, shape (n,). Its name is that of
the term, and its docstring has the formula and what differs from the paper. Weights are in `hugwbc.learned.config`
(`RewardWeights` and `ExtraWeights`), with the reasons for the terms of our own. C_i is the expected contact of foot i.
"""

import dataclasses
from collections.abc import Callable, Mapping

import torch

from hugwbc.commands import COMMAND_NAMES
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait, flies
from hugwbc.learned.config import EnvConfig, ExtraWeights, RewardTerm, RewardWeights
from hugwbc.learned.env.readings import Body, Transition, feet_on_ground, held_foot_down

TRACKING_SIGMA = 0.2
CONTACT_FORCE_SIGMA = 50.0  # [N^2]
CONTACT_VELOCITY_SIGMA = 5.0  # [m^2/s^2]; the paper prints the name of the force's constant twice
LIMIT_FRACTION = 0.95
PRECISION = 0.25  # [m/s] and [rad/s]
POSTURE_PRECISION = 0.1  # [m] and [rad]
SWING_PRECISION = 0.05  # [m]
LARGEST_YAW_RATE_ERROR = 4.0  # [rad^2/s^2]
LARGEST_VELOCITY_ERROR = 1.0  # [m^2/s^2]
LARGEST_VELOCITY_BIAS, LARGEST_YAW_RATE_BIAS = 0.5, 1.0  # [m/s], [rad/s]
SOFT_DESCENT = 0.3  # [m/s], of a sole one control step before it touches the ground
LARGEST_IMPACT = 4.0  # [m^2/s^2]
LARGEST_BOUNCE_ERROR = 2.0  # [m^2/s^2]
_OMEGA, _F, _H, _P, _W = (COMMAND_NAMES.index(name) for name in ("omega", "f", "h", "p", "w"))

Term = Callable[[Transition, Body], torch.Tensor]

# The paper's table: tracking -----------------------------------------------------------------------------------------


def linear_velocity_tracking(t: Transition, body: Body) -> torch.Tensor:
    """exp(-|v_xy_target - v_xy|^2 / 0.2)."""
    return torch.exp(-(t.command[:, :2] - t.velocity[:, :2]).square().sum(1) / TRACKING_SIGMA)


def angular_velocity_tracking(t: Transition, body: Body) -> torch.Tensor:
    """exp(-(omega_target - omega_z)^2 / 0.2)."""
    return torch.exp(-(t.command[:, _OMEGA] - t.yaw_rate).square() / TRACKING_SIGMA)


def body_height_tracking(t: Transition, body: Body) -> torch.Tensor:
    """(h_target - h)^2, with the clock's flight added to the target of jumps and hops, which the paper leaves out."""
    return (t.command[:, _H] + t.bounce[:, 0] - t.height).square()


def body_pitch_tracking(t: Transition, body: Body) -> torch.Tensor:
    """(p_target - p)^2."""
    return (t.command[:, _P] - t.pitch).square()


def waist_yaw_tracking(t: Transition, body: Body) -> torch.Tensor:
    """(w_target - w)^2."""
    return (t.command[:, _W] - t.q[:, body.waist]).square()


def foot_swing_tracking(t: Transition, body: Body) -> torch.Tensor:
    """sum_i (1 - C_i) (l_target_i - l_i)^2, with the corrected quintic profile of the swing."""
    return ((1.0 - t.contact) * (t.target_clearance - t.clearance).square()).sum(1)


def contact_swing_tracking(t: Transition, body: Body) -> torch.Tensor:
    """sum_i (1 - C_i) (1 - exp(-|f_i|^2 / 50)) + C_i (1 - exp(-|v_xy_i|^2 / 5)).

    Corrected: the paper prints positive exponents and a leading minus. The two sign errors cancel in direction, but
    the printed form is unbounded.
    """
    force = 1.0 - torch.exp(-t.foot_force.square().sum(2) / CONTACT_FORCE_SIGMA)
    speed = 1.0 - torch.exp(-t.foot_velocity[..., :2].square().sum(2) / CONTACT_VELOCITY_SIGMA)
    return ((1.0 - t.contact) * force + t.contact * speed).sum(1)


# The paper's table: regularisation -----------------------------------------------------------------------------------


def roll_pitch_angular_velocity(t: Transition, body: Body) -> torch.Tensor:
    """|omega_xy|^2."""
    return t.angular_velocity[:, :2].square().sum(1)


def vertical_body_movement(t: Transition, body: Body) -> torch.Tensor:
    """v_z^2 in stands and walks. The paper's term also counts jumps and hops, whose flight other terms ask for."""
    return t.velocity[:, 2].square() * ~flies(t.gait)


def feet_slip(t: Transition, body: Body) -> torch.Tensor:
    """sum_i (1 - exp(-|v_xy_i|^2)) over the feet on the ground.

    Corrected: the printed 1 - sum_i exp(-v_i^2) pays a bonus at rest and also judges the swing foot.
    """
    return (feet_on_ground(t.foot_force) * (1.0 - torch.exp(-t.foot_velocity[..., :2].square().sum(2)))).sum(1)


def _upper_mask(t: Transition, body: Body) -> torch.Tensor:
    """Return 0 for the arms while I = 1, when the paper masks the upper body's regularisation, and 1 for the rest."""
    # What intervened arms do is not the choice of the policy: penalising it would only add noise to the reward.
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
    """|q_upper - q_upper_nominal|^2 of the arms, masked while I = 1, and of joints in no chain (`Robot.held`)."""
    deviation = (t.q - body.nominal).square()
    return deviation[:, body.arms].sum(1) * ~t.intervention + deviation[:, body.held].sum(1)


def hip_joint_deviation(t: Transition, body: Body) -> torch.Tensor:
    """Squared deviation of hip yaw and hip roll from nominal (the paper's hip x and z)."""
    return (t.q - body.nominal)[:, body.hips].square().sum(1)


def feet_symmetry(t: Transition, body: Body) -> torch.Tensor:
    """1[phi_left = phi_right] |p_xz of the left foot - p_xz of the right foot|^2, in the heading frame."""
    return t.in_phase * (t.foot_offset[:, 0].square() + t.foot_offset[:, 2].square())


def termination(t: Transition, body: Body) -> torch.Tensor:
    """1 at an early termination."""
    return t.fallen.to(t.command.dtype)


# Terms of our own ----------------------------------------------------------------------------------------------------
#
# A squared exponential is flat near zero error and again far from it. exp(-|e| / s) ("precision") keeps its slope near
# zero, so that small errors vanish; e^2 ("error") keeps it far away, where noise and oscillation carry the state.
# Errors are bounded so that a single stumble does not outweigh the rest of an episode.


def alive(t: Transition, body: Body) -> torch.Tensor:
    """1 while not terminated (not in the paper)."""
    return (~t.fallen).to(t.command.dtype)


def body_roll_tracking(t: Transition, body: Body) -> torch.Tensor:
    """roll^2 (not in the paper's table; part of the authors' pitch term)."""
    return t.roll.square()


def joint_limits(t: Transition, body: Body) -> torch.Tensor:
    """Radians beyond 95 % of the range, summed over all joints but the arms' (not in the paper)."""
    centre, half = (body.upper + body.lower) / 2.0, (body.upper - body.lower) / 2.0
    excess = ((t.q - centre).abs() - LIMIT_FRACTION * half).clamp(min=0.0)
    return excess[:, body.waist_and_legs].sum(1)


def linear_velocity_precision(t: Transition, body: Body) -> torch.Tensor:
    """exp(-|v_xy_target - v_xy| / 0.25) (not in the paper)."""
    return torch.exp(-torch.linalg.vector_norm(t.command[:, :2] - t.velocity[:, :2], dim=1) / PRECISION)


def linear_velocity_error(t: Transition, body: Body) -> torch.Tensor:
    """|v_xy_target - v_xy|^2, at most 1 (not in the paper)."""
    return (t.command[:, :2] - t.velocity[:, :2]).square().sum(1).clamp(max=LARGEST_VELOCITY_ERROR)


def yaw_rate_precision(t: Transition, body: Body) -> torch.Tensor:
    """exp(-|omega_target - omega_z| / 0.25) (not in the paper)."""
    return torch.exp(-(t.command[:, _OMEGA] - t.yaw_rate).abs() / PRECISION)


def yaw_rate_error(t: Transition, body: Body) -> torch.Tensor:
    """(omega_target - omega_z)^2, at most 4 (not in the paper)."""
    return (t.command[:, _OMEGA] - t.yaw_rate).square().clamp(max=LARGEST_YAW_RATE_ERROR)


def posture_precision(t: Transition, body: Body) -> torch.Tensor:
    """Mean of exp(-|e| / 0.1) over body height, body pitch and waist yaw (not in the paper)."""
    errors = torch.stack(
        (
            t.command[:, _H] + t.bounce[:, 0] - t.height,
            t.command[:, _P] - t.pitch,
            t.command[:, _W] - t.q[:, body.waist],
        ),
        dim=1,
    )
    return torch.exp(-errors.abs() / POSTURE_PRECISION).mean(1)


def swing_precision(t: Transition, body: Body) -> torch.Tensor:
    """sum_i (1 - C_i) exp(-|l_target_i - l_i| / 0.05) (not in the paper)."""
    return ((1.0 - t.contact) * torch.exp(-(t.target_clearance - t.clearance).abs() / SWING_PRECISION)).sum(1)


def velocity_bias(t: Transition, body: Body) -> torch.Tensor:
    """|b_xy|, at most 0.5 m/s, with b the velocity error filtered over half a second (not in the paper)."""
    return torch.linalg.vector_norm(t.bias[:, :2], dim=1).clamp(max=LARGEST_VELOCITY_BIAS)


def yaw_rate_bias(t: Transition, body: Body) -> torch.Tensor:
    """|b_omega|, at most 1 rad/s, with b the yaw rate's error filtered over half a second (not in the paper)."""
    return t.bias[:, 2].abs().clamp(max=LARGEST_YAW_RATE_BIAS)


def foot_impact(t: Transition, body: Body) -> torch.Tensor:
    """sum_i min(4, max(0, d_i - d_0 - b)^2) over feet that touch down (not in the paper).

    d_i is the speed of descent one control step before: contact stops a sole within a step. d_0 is 0.3 m/s, and b the
    speed at which jumps and hops fall by the clock.
    """
    falling = (-t.bounce[:, [1]]).clamp(min=0.0)
    excess = (t.descent - SOFT_DESCENT - falling).clamp(min=0.0).square().clamp(max=LARGEST_IMPACT)
    return (t.touch_down * excess).sum(1)


def contact_mismatch(t: Transition, body: Body) -> torch.Tensor:
    """sum_i |C_i - c_i|, with c_i whether foot i is on the ground, but for standing (not in the paper)."""
    mismatch = (t.contact - feet_on_ground(t.foot_force).to(t.contact.dtype)).abs().sum(1)
    return mismatch * (t.gait != int(Gait.STANDING))


def flight_contact(t: Transition, body: Body) -> torch.Tensor:
    """sum_i (1 - C_i) c_i in jumping and hopping (not in the paper)."""
    touching = ((1.0 - t.contact) * feet_on_ground(t.foot_force)).sum(1)
    return touching * flies(t.gait)


def bounce_tracking(t: Transition, body: Body) -> torch.Tensor:
    """exp(-(b - v_z)^2 / 0.2) in jumps, and in hops with the held foot up, with b the speed of the clock's flight.

    Not in the paper. If it paid for hops with the held foot down, robots would hop on both feet.
    """
    error = (t.bounce[:, 1] - t.velocity[:, 2]).square()
    return torch.exp(-error / TRACKING_SIGMA) * (flies(t.gait) & ~held_foot_down(t, t.gait))


def bounce_error(t: Transition, body: Body) -> torch.Tensor:
    """(b - v_z)^2, at most 2, in jumping, with b the speed of the clock's flight (not in the paper)."""
    error = (t.bounce[:, 1] - t.velocity[:, 2]).square()
    return error.clamp(max=LARGEST_BOUNCE_ERROR) * (t.gait == int(Gait.JUMPING))


def unequal_support(t: Transition, body: Body) -> torch.Tensor:
    """1[phi_left = phi_right] while one foot is on the ground and the other is not (not in the paper)."""
    on_ground = feet_on_ground(t.foot_force)
    return (t.in_phase & (on_ground[:, 0] != on_ground[:, 1])).to(t.command.dtype)


# Tables and evaluation -----------------------------------------------------------------------------------------------

_PAPER, _EXTRA = ([field.name for field in dataclasses.fields(kind)] for kind in (RewardWeights, ExtraWeights))
TERMS: dict[str, Term] = {name: globals()[name] for name in (*_PAPER, *_EXTRA)}
"""The function of each weight, which has its name."""
# Terms that the penalty curriculum scales. Termination is not one of them: a fall must cost as much in early training.
REGULARISATION = frozenset(_PAPER) - {
    "linear_velocity_tracking",
    "angular_velocity_tracking",
    "body_height_tracking",
    "body_pitch_tracking",
    "waist_yaw_tracking",
    "foot_swing_tracking",
    "contact_swing_tracking",
    "termination",
} | {
    "joint_limits",
    "velocity_bias",
    "yaw_rate_bias",
    "foot_impact",
    "contact_mismatch",
    "flight_contact",
}


def reward_terms(config: EnvConfig) -> dict[str, RewardTerm]:
    """Return all terms with a weight other than zero, by name; those of a user's settings come last."""
    weights = dataclasses.asdict(config.rewards) | dataclasses.asdict(config.extra)
    ours = {name: RewardTerm(TERMS[name], weight, name in REGULARISATION) for name, weight in weights.items()}
    return {name: term for name, term in (ours | config.terms).items() if term.weight != 0.0}


def check_terms(terms: Mapping[str, RewardTerm], transition: Transition, body: Body) -> None:
    """Try the terms of a user's settings on a control step; raise ConfigError unless each gives finite numbers."""
    for name, term in terms.items():
        value = term.function(transition, body)
        shape = tuple(transition.fallen.shape)
        if not isinstance(value, torch.Tensor) or value.shape != shape or not bool(torch.isfinite(value).all()):
            raise ConfigError(f"reward '{name}' gives {value}; give a tensor of finite numbers, here of shape {shape}")


def evaluate_terms(
    terms: Mapping[str, RewardTerm], transition: Transition, body: Body, penalty_scale: float
) -> dict[str, torch.Tensor]:
    """Return the weighted rewards of a control step by term.

    Returns:
        Rewards by term, shape (n,) each, already multiplied by the control period.
    """
    rewards = {}
    for name, term in terms.items():
        scale = penalty_scale if term.penalty else 1.0
        rewards[name] = term.weight * scale * body.dt * term.function(transition, body)
    return rewards


def relative_tracking(rewards: Mapping[str, torch.Tensor], terms: Mapping[str, RewardTerm], dt: float) -> torch.Tensor:
    """Return the linear and angular tracking reward relative to their maxima, for the curricula, shape (n, 2)."""
    names = (linear_velocity_tracking.__name__, angular_velocity_tracking.__name__)
    return torch.stack([rewards[name] / (terms[name].weight * dt) for name in names], dim=1)
