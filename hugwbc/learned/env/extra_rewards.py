"""Reward terms that the paper's table lacks, as those of `hugwbc.learned.env.rewards`; reasons in docs/learned.md."""

import torch

from hugwbc.commands import COMMAND_NAMES
from hugwbc.learned.env.readings import feet_on_ground
from hugwbc.learned.env.transition import Body, Term, Transition

LIMIT_FRACTION = 0.95
PRECISION = 0.25  # [m/s] and [rad/s]
POSTURE_PRECISION = 0.1  # [m] and [rad]
SWING_PRECISION = 0.05  # [m]
LARGEST_YAW_RATE_ERROR = 4.0  # [rad^2/s^2]
LARGEST_VELOCITY_ERROR = 1.0  # [m^2/s^2]
_OMEGA, _H, _P, _W = (COMMAND_NAMES.index(name) for name in ("omega", "h", "p", "w"))


def alive(t: Transition, body: Body) -> torch.Tensor:
    """1 while not terminated (not in the paper)."""
    return (~t.fallen).to(t.command.dtype)


def body_roll_tracking(t: Transition, body: Body) -> torch.Tensor:
    """roll^2 (not in the paper's table; part of the authors' pitch term)."""
    return t.roll.square()


def joint_limits(t: Transition, body: Body) -> torch.Tensor:
    """Radians beyond 95 % of the range, summed over legs and waist (not in the paper)."""
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
        (t.command[:, _H] - t.height, t.command[:, _P] - t.pitch, t.command[:, _W] - t.q[:, body.waist]), dim=1
    )
    return torch.exp(-errors.abs() / POSTURE_PRECISION).mean(1)


def swing_precision(t: Transition, body: Body) -> torch.Tensor:
    """sum_i (1 - C_i) exp(-|l_target_i - l_i| / 0.05) (not in the paper)."""
    return ((1.0 - t.contact) * torch.exp(-(t.target_clearance - t.clearance).abs() / SWING_PRECISION)).sum(1)


def unequal_support(t: Transition, body: Body) -> torch.Tensor:
    """1[bar phi_1 = bar phi_2] while one foot is on the ground and the other is not (not in the paper)."""
    on_ground = feet_on_ground(t.foot_force)
    return (t.in_phase & (on_ground[:, 0] != on_ground[:, 1])).to(t.command.dtype)


EXTRA_TERMS: dict[str, Term] = {
    term.__name__: term
    for term in (
        alive,
        body_roll_tracking,
        joint_limits,
        linear_velocity_precision,
        linear_velocity_error,
        yaw_rate_precision,
        yaw_rate_error,
        posture_precision,
        swing_precision,
        unequal_support,
    )
}
