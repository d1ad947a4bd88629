"""Curricula of the training (penalty scale, noise level of the intervention, speeds), and the draws of commands.

The penalty scale grows by itself. Noise level and speed each grow if the tracking rewards that they depend on are high
enough: their gate is open. Every gate says in words why it is closed, and all levels are in `state_dict`. A user's
settings may have rules that move further settings.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import torch

from hugwbc.commands import COMMAND_NAMES, command_ranges
from hugwbc.gait import Gait, hopping as hopping_gait
from hugwbc.learned.config import CommandConfig, CurriculumConfig, EnvConfig
from hugwbc.learned.config.schedules import replaced, value_of
from hugwbc.learned.env.randomization import rand, uniform
from hugwbc.robot import Robot

RULE = "rule."  # before the names of settings, in the state
_OMEGA = COMMAND_NAMES.index("omega")
_BEHAVIOUR = tuple(COMMAND_NAMES.index(name) for name in ("f", "l", "h", "p", "w"))


@dataclasses.dataclass
class Curriculum:
    """Levels of the training; their moves are those of `CurriculumConfig`.

    Attributes:
        config: thresholds and steps.
        robot: the robot, whose ranges of commands count.
        iteration: number of moves so far.
        penalty_scale: factor on the regularisation rewards.
        alpha: noise level of the intervention.
        max_speed: largest v_x of the agile group [m/s].
        speeds, yaw_rates: largest v_x [m/s] and |omega| [rad/s] at the start and at the end.
        agile, intervened: mean linear and angular tracking reward of both groups, relative to their maxima, at the last
            move; None if the group is empty.
        values: settings that the rules have moved, by name.
        gates: last decision of each curriculum, in words.
    """

    config: CurriculumConfig
    robot: Robot
    iteration: int = 0
    penalty_scale: float = dataclasses.field(init=False)
    alpha: float = 0.0
    max_speed: float = dataclasses.field(init=False)
    speeds: tuple[float, float] = dataclasses.field(init=False)
    yaw_rates: tuple[float, float] = dataclasses.field(init=False)
    agile: tuple[float, float] | None = None
    intervened: tuple[float, float] | None = None
    values: dict[str, float] = dataclasses.field(default_factory=dict)
    gates: dict[str, str] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Start at the configured penalty and at the initial speeds."""
        ranges = command_ranges(Gait.WALKING, self.robot)
        self.speeds, self.yaw_rates = ((ranges[n].initial[1], ranges[n].finishing[1]) for n in ("v_x", "omega"))
        self.penalty_scale, self.max_speed = self.config.penalty_start, self.speeds[0]

    @property
    def max_yaw_rate(self) -> float:
        """Largest |omega| of the agile group [rad/s], which grows in proportion to the speed."""
        growth = self.speeds[1] - self.speeds[0]
        progress = (self.max_speed - self.speeds[0]) / growth if growth > 0.0 else 1.0
        return self.yaw_rates[0] + progress * (self.yaw_rates[1] - self.yaw_rates[0])

    def update(self, agile: tuple[float, float] | None, intervened: tuple[float, float] | None) -> None:
        """Move the levels once.

        Args:
            agile: mean linear and angular tracking reward of the agile group relative to their maxima; None if the
                group is empty.
            intervened: the same of the intervention group; None if there is no intervention.
        """
        self.iteration += 1
        self.agile, self.intervened = agile, intervened
        # The running rewards start at zero, and the policy has only begun to learn.
        if self._warming_up:
            waiting = ("penalty", "alpha", "speed")
            end = self.config.warm_up_iterations * self.config.steps
            self.gates = dict.fromkeys(waiting, f"warm-up until {end:.3g} steps")
            return
        self.penalty_scale = min(1.0, self.penalty_scale * self.config.penalty_growth)
        self.gates["penalty"] = f"{self.penalty_scale:.3f}"
        if intervened is None:
            self.gates["alpha"] = "off: no intervention"
        elif self.iteration % self.config.alpha_interval == 0:
            self._update_alpha(*intervened)
        if agile is None:
            self.gates["speed"] = "off: no agile robots"
        elif self.iteration % self.config.speed_interval == 0:
            self._update_speed(agile[0])

    @property
    def _warming_up(self) -> bool:
        return self.iteration <= self.config.warm_up_iterations

    def apply_rules(self, config: EnvConfig) -> None:
        """Let each rule of the settings move the value of its setting, unless the warm-up is still on."""
        if self._warming_up:
            return
        for name, rule in self.config.rules.items():
            present = value_of(config, name)
            value = float(rule(present, self))
            self.values[name] = round(value) if type(present) is int else value

    def applied(self, config: EnvConfig) -> EnvConfig:
        """Return the settings with the values that the rules have moved."""
        return replaced(config, self.values) if self.values else config

    def _update_alpha(self, linear: float, angular: float) -> None:
        """Apply the paper's rule: raise alpha above both thresholds, lower it below two thirds of either."""
        thresholds = {"linear": self.config.linear_threshold, "angular": self.config.angular_threshold}
        values = {"linear": linear, "angular": angular}
        short = [
            f"{n} velocity reward {values[n]:.2f} < {thresholds[n]:.2f}" for n in values if values[n] < thresholds[n]
        ]
        # Between the two bounds alpha rests: without this dead band it would rise and fall at every decision.
        if not short:
            self.alpha = min(1.0, self.alpha + self.config.alpha_step)
            self.gates["alpha"] = "open"
        elif any(values[n] < 2.0 / 3.0 * thresholds[n] for n in values):
            self.alpha = max(0.0, self.alpha - self.config.alpha_step)
            self.gates["alpha"] = "falling: " + ", ".join(short)
        else:
            self.gates["alpha"] = "closed: " + ", ".join(short)

    def _update_speed(self, linear: float) -> None:
        threshold = self.config.speed_threshold
        if linear >= threshold:
            self.max_speed = min(self.speeds[1], self.max_speed + self.config.speed_step)
            self.gates["speed"] = "open"
        else:
            self.gates["speed"] = f"closed: linear velocity reward {linear:.2f} < {threshold:.2f}"

    def state_dict(self) -> dict[str, Any]:
        """Return the levels in a form that JSON can hold."""
        state: dict[str, Any] = {
            name: getattr(self, name)
            for name in ("iteration", "penalty_scale", "alpha", "max_speed", "agile", "intervened")
            if getattr(self, name) is not None
        }
        return state | {f"{RULE}{name}": value for name, value in self.values.items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore the levels."""
        self.iteration = int(state["iteration"])
        self.penalty_scale, self.alpha, self.max_speed = (
            float(state[name]) for name in ("penalty_scale", "alpha", "max_speed")
        )
        self.agile, self.intervened = (_pair(state.get(name)) for name in ("agile", "intervened"))
        stored = {name: state.get(f"{RULE}{name}") for name in self.config.rules}
        self.values = {name: float(value) for name, value in stored.items() if value is not None}


def _pair(value: Any) -> tuple[float, float] | None:  # noqa: ANN401  what a file holds
    """Return the two numbers in a file; None if there are none, as in files of earlier versions."""
    if value is None:
        return None
    linear, angular = value
    return float(linear), float(angular)


def draw_gaits(count: int, config: CommandConfig, generator: torch.Generator) -> torch.Tensor:
    """Draw values of `Gait` in the configured fractions, shape (count,)."""
    order = Gait.STANDING, Gait.WALKING, Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT, Gait.JUMPING
    gaits = torch.tensor(order, device=generator.device)
    hopping = config.hopping_fraction / 2.0
    shares = torch.tensor([config.standing_fraction, config.walking_fraction, hopping, hopping], dtype=torch.float64)
    shares = shares.cumsum(0).to(generator.device)
    draw = rand(generator, count).double()
    return gaits[torch.bucketize(draw, shares, right=True)]


def draw_commands(
    gait: torch.Tensor, agile: torch.Tensor, config: CommandConfig, curriculum: Curriculum, generator: torch.Generator
) -> torch.Tensor:
    """Draw commands for gaits.

    Each command is uniform over its range at the end of the training, but v_x and |omega| are at most what they are at
    the start, or in the agile group what the curriculum has reached. Each of f, l, h, p and w is at its default with
    probability `default_fraction`; in `combined_fraction` of the commands, or `combined_stands` of the stands, all five
    are drawn. Standing and stepping in place have no velocity.

    Hopping has the paper's smaller command space: v_x, v_y, omega and h. The other commands stay at their defaults, so
    that their tracking rewards act as regularisers.

    Args:
        gait: values of `Gait`, shape (k,).
        agile: whether each robot belongs to the agile group, shape (k,), bool.
        config: the probabilities.
        curriculum: the robot and the speeds reached so far.
        generator: source of the draws.

    Returns:
        Commands in the order of `COMMAND_NAMES`, shape (k, 8).
    """
    count = gait.numel()
    standing, hopping = gait == Gait.STANDING, hopping_gait(gait)
    agile = agile & ~hopping
    ranges = command_ranges(Gait.WALKING, curriculum.robot)
    hops = command_ranges(Gait.HOPPING_LEFT, curriculum.robot)
    reached = {
        "v_x": torch.where(agile, curriculum.max_speed, curriculum.speeds[0]),
        "omega": torch.where(agile, curriculum.max_yaw_rate, curriculum.yaw_rates[0]),
    }
    columns = []
    for name in COMMAND_NAMES:
        low, high = ranges[name].finishing
        most = reached.get(name, torch.full((count,), high, device=gait.device))
        least = torch.clamp(-most, min=low) if name == "omega" else torch.full_like(most, low)
        least, most = (
            torch.where(hopping, end, of_walks)
            for end, of_walks in zip(hops[name].finishing, (least, most.clamp(max=high)), strict=True)
        )
        columns.append(uniform(generator, count, least, most))
    command = torch.stack(columns, dim=1)
    stands = config.combined_fraction if config.combined_stands is None else config.combined_stands
    combined = torch.where(standing, stands, config.combined_fraction)
    single = rand(generator, count) >= combined
    for i in _BEHAVIOUR:
        at_default = rand(generator, count) < config.default_fraction
        command[:, i].masked_fill_(single & at_default, ranges[COMMAND_NAMES[i]].default)
    still = rand(generator, count) < config.zero_velocity_fraction
    command[:, : _OMEGA + 1].masked_fill_((standing | still)[:, None], 0.0)
    return command
