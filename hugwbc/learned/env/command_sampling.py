"""Drawing gaits and commands for training."""

import torch

from hugwbc.commands import COMMAND_NAMES, command_ranges
from hugwbc.gait import Gait, hopping as hopping_gait
from hugwbc.learned.config import CommandConfig
from hugwbc.learned.env.curriculum import Curriculum
from hugwbc.learned.env.random_numbers import rand, uniform

_V_X, _OMEGA = COMMAND_NAMES.index("v_x"), COMMAND_NAMES.index("omega")
_BEHAVIOUR = tuple(COMMAND_NAMES.index(name) for name in ("f", "l", "h", "p", "w"))


def draw_commands(
    agile: torch.Tensor,
    config: CommandConfig,
    curriculum: Curriculum,
    generator: torch.Generator,
    loaded: torch.Tensor | None = None,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Draw gaits and commands.

    Each command is uniform over its initial range. v_x and omega of the agile group are uniform over the range that
    the curriculum has reached. Each behaviour command is at its default with probability `default_fraction`, but
    in `combined_fraction` of the commands, or `combined_stands` of the stands, none is. Standing and stepping in place
    have no velocity.

    Hopping has the paper's smaller command space: v_x, v_y, omega and h. The other commands stay at their defaults, so
    that their tracking rewards act as regularisers.

    Args:
        agile: whether each robot belongs to the agile group, shape (k,), bool.
        config: the probabilities.
        curriculum: the robot and the speeds reached so far.
        generator: source of the draws.
        loaded: which robots carry something and walk instead of hopping, shape (k,), bool; None for none.

    Returns:
        Commands in the order of `COMMAND_NAMES`, shape (k, 8), and values of `Gait`, shape (k,).
    """
    count = agile.numel()
    gait = _draw_gaits(count, config, generator)
    if loaded is not None:
        gait[loaded & hopping_gait(gait)] = Gait.WALKING
    standing, hopping = gait == Gait.STANDING, hopping_gait(gait)
    agile = agile & ~hopping
    ranges = command_ranges(Gait.WALKING, curriculum.robot)
    columns = [uniform(generator, count, *ranges[name].initial) for name in COMMAND_NAMES]
    fast = torch.where(agile, curriculum.max_speed, curriculum.speeds[0])
    columns[_V_X] = uniform(generator, count, ranges["v_x"].initial[0], fast)
    turn = torch.where(agile, curriculum.max_yaw_rate, curriculum.yaw_rates[0])
    columns[_OMEGA] = uniform(generator, count, -turn, turn)
    command = torch.stack(columns, dim=1)
    stands = config.combined_fraction if config.combined_stands is None else config.combined_stands
    combined = torch.where(standing, stands, config.combined_fraction)
    single = rand(generator, count) >= combined
    for i in _BEHAVIOUR:
        at_default = rand(generator, count) < config.default_fraction
        command[:, i].masked_fill_(single & at_default, ranges[COMMAND_NAMES[i]].default)
    still = rand(generator, count) < config.zero_velocity_fraction
    command[:, : _OMEGA + 1].masked_fill_((standing | still)[:, None], 0.0)
    # A range of hopping is the general one or the default alone, so clamping keeps the draws uniform.
    hops = [limits.initial for limits in command_ranges(Gait.HOPPING_LEFT, curriculum.robot).values()]
    low, high = torch.tensor(hops, device=command.device).T
    return torch.where(hopping[:, None], command.clamp(low, high), command), gait


def _draw_gaits(count: int, config: CommandConfig, generator: torch.Generator) -> torch.Tensor:
    """Draw values of `Gait` in the configured fractions, shape (count,)."""
    order = Gait.STANDING, Gait.WALKING, Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT, Gait.JUMPING
    gaits = torch.tensor(order, device=generator.device)
    hopping = config.hopping_fraction / 2.0
    shares = torch.tensor([config.standing_fraction, config.walking_fraction, hopping, hopping], dtype=torch.float64)
    shares = shares.cumsum(0).to(generator.device)
    draw = rand(generator, count).double()
    return gaits[torch.bucketize(draw, shares, right=True)]
