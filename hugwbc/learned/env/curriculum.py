"""Curricula of the training: penalty scale, noise level of the intervention, speed of the agile group.

A level moves when the tracking rewards that it depends on are high enough: its gate is open. Every gate says in words
why it is closed, and all levels are in `state_dict`.

The speeds of the agile group grow as one range or on a grid. The grid is the rule of Margolis et al., "Rapid
Locomotion via Reinforcement Learning" (RSS 2022): the probability of a cell of the (v_x, omega) plane grows when
commands in it or next to it are tracked well. Walking and jumping have a grid each.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import torch

from hugwbc.commands import COMMAND_NAMES, command_ranges
from hugwbc.gait import Gait
from hugwbc.learned import distributed
from hugwbc.learned.config import CurriculumConfig
from hugwbc.learned.env.own_curricula import Measured, OwnLevels

SPEED_COLUMNS = [COMMAND_NAMES.index("v_x"), COMMAND_NAMES.index("omega")]  # the columns of a command on the grid
GAITS = (Gait.WALKING, Gait.JUMPING)  # that have a grid
CELLS = (13, 10)  # along v_x and omega
STEP = 0.2  # growth of a cell's weight, up to 1
_RANGES = [command_ranges(Gait.WALKING)[name] for name in ("v_x", "omega")]
# Largest v_x [m/s] and omega [rad/s] at the start and at the end.
MAX_SPEED, MAX_YAW_RATE = ((limits.initial[1], limits.finishing[1]) for limits in _RANGES)
_LOW = torch.tensor([limits.finishing[0] for limits in _RANGES])
# Of a cell: 0.2 m/s and 0.2 rad/s.
_SIZE = torch.tensor(
    [(high - low) / cells for (low, high), cells in zip((r.finishing for r in _RANGES), CELLS, strict=True)]
)


class SpeedGrid:
    """Which combinations of v_x and omega the agile group is asked for: a weight per cell and gait.

    Attributes:
        weight: relative probability of each cell, from 0 to 1, shape (gaits, 13, 10).
        passed: number of commands in each cell that were tracked well since the last update, same shape.
    """

    def __init__(self, weight: torch.Tensor) -> None:
        """Start with the given weights, shape (gaits, 13, 10)."""
        self.weight = weight
        self.passed = torch.zeros_like(weight)
        self._judged, self._failed, self._short = 0, 0, torch.zeros(2)

    @classmethod
    def up_to(cls, speed: float, yaw_rate: float) -> "SpeedGrid":
        """Open the cells whose centres satisfy v_x <= `speed` [m/s] and |omega| <= `yaw_rate` [rad/s]."""
        v_x, omega = (_LOW[i] + (torch.arange(CELLS[i]) + 0.5) * _SIZE[i] for i in (0, 1))
        weight = ((v_x <= speed)[:, None] & (omega.abs() <= yaw_rate)).float().repeat(len(GAITS), 1, 1)
        return cls(weight)

    def draw(self, gait: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """Draw cells by weight, and v_x and omega uniformly within each, shape (k, 2).

        Args:
            gait: values of `Gait`, walking or jumping, shape (k,).
            generator: source of the draws.
        """
        weight = self.weight[(gait == Gait.JUMPING).long()].flatten(1)
        cell = torch.multinomial(weight, 1, generator=generator)
        place = torch.cat((cell // CELLS[1], cell % CELLS[1]), dim=1)
        return _LOW + (place + torch.rand(place.shape, generator=generator)) * _SIZE

    def judge(
        self, gait: torch.Tensor, command: torch.Tensor, tracking: torch.Tensor, thresholds: tuple[float, float]
    ) -> None:
        """Note how well robots of the agile group tracked their command to its end.

        Args:
            gait: values of `Gait`, shape (k,); only walking and jumping count.
            command: v_x and omega, shape (k, 2).
            tracking: linear and angular tracking reward relative to their maxima, shape (k, 2); 0 after a fall.
            thresholds: values of the two from which a command counts as passed.
        """
        moving = (gait == Gait.WALKING) | (gait == Gait.JUMPING)
        gait, command, tracking = gait[moving], command[moving], tracking[moving]
        passed = (tracking >= torch.tensor(thresholds)).all(1)
        last = torch.tensor(CELLS) - 1
        cell = torch.minimum(((command - _LOW) / _SIZE).long().clamp(min=0), last)[passed]
        where = ((gait == Gait.JUMPING).long()[passed], cell[:, 0], cell[:, 1])
        self.passed.index_put_(where, torch.ones(len(cell)), accumulate=True)
        self._judged += gait.numel()
        self._failed += int((~passed).sum())
        self._short = self._short + tracking[~passed].sum(0)

    def update(self) -> None:
        """Raise the weights of passed cells and of their eight neighbours, equally in all processes."""
        # A command just outside of the open cells cannot pass: the neighbours of a passed cell open with it.
        counts = distributed.total(self.passed)
        spread = torch.nn.functional.conv2d(counts[:, None], torch.ones(1, 1, 3, 3), padding=1)[:, 0]
        self.weight = (self.weight + STEP * spread).clamp(max=1.0)
        self.passed = torch.zeros_like(self.weight)

    @property
    def max_speed(self) -> float:
        """Upper end of the fastest open cell of walking [m/s]."""
        open_cells = (self.weight[0] > 0.0).any(1).nonzero()
        return float(_LOW[0] + (open_cells.max() + 1) * _SIZE[0])

    def report(self, thresholds: tuple[float, float]) -> str:
        """Describe in words what was judged since the last call.

        Args:
            thresholds: of the linear and the angular tracking reward.
        """
        cells = ", ".join(
            f"{gait.label} {int((weight > 0.0).sum())} of {weight.numel()} cells"
            for gait, weight in zip(GAITS, self.weight, strict=True)
        )
        text = f"{cells}; {self._judged - self._failed} of {self._judged} commands passed"
        means = (self._short / max(self._failed, 1)).tolist()
        for name, mean, threshold in zip(("linear", "angular"), means, thresholds, strict=True):
            if self._failed and mean < threshold:
                text += f", the others' {name} velocity reward {mean:.2f} < {threshold:.2f}"
        self._judged, self._failed, self._short = 0, 0, torch.zeros(2)
        return text


@dataclasses.dataclass
class Curriculum:
    """Levels of the training that move once per iteration.

    Attributes:
        config: thresholds and steps.
        iteration: number of iterations so far.
        penalty_scale: factor on the regularisation rewards.
        alpha: noise level of the intervention.
        max_speed: largest v_x of the agile group [m/s].
        grid: speeds of the agile group by cell; None if they have one range.
        own: levels of the curricula of other packages.
        gates: last decision of each curriculum's gate, in words.
    """

    config: CurriculumConfig
    iteration: int = 0
    penalty_scale: float = dataclasses.field(init=False)
    alpha: float = 0.0
    max_speed: float = MAX_SPEED[0]
    grid: SpeedGrid | None = dataclasses.field(init=False)
    own: OwnLevels = dataclasses.field(init=False)
    gates: dict[str, str] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Start at the configured penalty and at the paper's initial speeds."""
        self.penalty_scale = self.config.penalty_start
        self.grid = SpeedGrid.up_to(MAX_SPEED[0], MAX_YAW_RATE[0]) if self.config.speed == "grid" else None
        self.own = OwnLevels(self.config)

    @property
    def max_yaw_rate(self) -> float:
        """Largest |omega| of the agile group [rad/s], which grows in proportion to the speed."""
        progress = (self.max_speed - MAX_SPEED[0]) / (MAX_SPEED[1] - MAX_SPEED[0])
        return MAX_YAW_RATE[0] + progress * (MAX_YAW_RATE[1] - MAX_YAW_RATE[0])

    def update(
        self,
        agile: tuple[float, float] | None,
        intervened: tuple[float, float] | None,
        *,
        terrain_mastered: bool = True,
    ) -> None:
        """Move the levels after an iteration.

        Args:
            agile: mean linear and angular tracking reward of the agile group relative to their maxima; None if the
                group is empty.
            intervened: the same of the intervention group; None if there is no intervention.
            terrain_mastered: whether the level of the terrain allows noise and speed to move.
        """
        self.iteration += 1
        # The running rewards start at zero, and the policy has only begun to learn.
        if self.iteration <= self.config.warm_up_iterations:
            waiting = ("penalty", "alpha", "speed", *self.own.values)
            self.gates = dict.fromkeys(waiting, f"warm-up until {self.config.warm_up_iterations}")
            return
        self._update_ours(agile, intervened, terrain_mastered=terrain_mastered)
        levels = (self.penalty_scale, self.alpha, self.max_speed)
        self.gates |= self.own.move(Measured(self.iteration, agile, intervened, *levels))

    def _update_ours(
        self, agile: tuple[float, float] | None, intervened: tuple[float, float] | None, *, terrain_mastered: bool
    ) -> None:
        self.penalty_scale = min(1.0, self.penalty_scale * self.config.penalty_growth)
        self.gates["penalty"] = f"{self.penalty_scale:.3f}"
        if not terrain_mastered:
            self.gates |= dict.fromkeys(("alpha", "speed"), "closed: waits for the terrain")
            return
        if intervened is None:
            self.gates["alpha"] = "off: no intervention"
        elif self.iteration % self.config.alpha_interval == 0:
            self._update_alpha(*intervened)
        if agile is None:
            self.gates["speed"] = "off: no agile robots"
        elif self.iteration % self.config.speed_interval == 0:
            if self.grid is None:
                self._update_speed(agile[0])
            else:
                self._update_grid(self.grid)

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
            self.max_speed = min(MAX_SPEED[1], self.max_speed + self.config.speed_step)
            self.gates["speed"] = "open"
        else:
            self.gates["speed"] = f"closed: linear velocity reward {linear:.2f} < {threshold:.2f}"

    def judge(self, gait: torch.Tensor, command: torch.Tensor, tracking: torch.Tensor) -> None:
        """Pass commands of the agile group that have ended to the speed grid, if there is one.

        Args:
            gait: values of `Gait`, shape (k,).
            command: in the order of `COMMAND_NAMES`, shape (k, 8).
            tracking: linear and angular tracking reward relative to their maxima, shape (k, 2); 0 after a fall.
        """
        if self.grid is not None:
            self.grid.judge(gait, command[:, SPEED_COLUMNS], tracking, self.speed_thresholds)

    @property
    def speed_thresholds(self) -> tuple[float, float]:
        """Linear and angular tracking reward from which a cell of the grid counts as passed."""
        return self.config.speed_threshold, self.config.speed_angular_threshold

    def _update_grid(self, grid: SpeedGrid) -> None:
        grid.update()
        self.max_speed = grid.max_speed
        self.gates["speed"] = grid.report(self.speed_thresholds)

    def state_dict(self) -> dict[str, Any]:
        """Return the levels in a form that JSON can hold."""
        state: dict[str, Any] = {
            name: getattr(self, name) for name in ("iteration", "penalty_scale", "alpha", "max_speed")
        }
        if self.grid is not None:
            state |= {"grid": self.grid.weight.tolist(), "grid_passed": self.grid.passed.tolist()}
        return state | {f"own_{name}": level for name, level in self.own.values.items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore the levels; without a stored grid, one starts from the speed that was reached."""
        self.iteration = int(state["iteration"])
        self.penalty_scale, self.alpha, self.max_speed = (
            float(state[name]) for name in ("penalty_scale", "alpha", "max_speed")
        )
        # A curriculum that was not there when the state was stored starts at its beginning.
        self.own.restore({name: float(state.get(f"own_{name}", 0.0)) for name in self.own.values})
        if self.grid is not None:
            self.grid = SpeedGrid.up_to(self.max_speed, self.max_yaw_rate)
            if "grid" in state:
                self.grid.weight = torch.tensor(state["grid"], dtype=torch.float32)
            if "grid_passed" in state:  # absent from older checkpoints
                self.grid.passed = torch.tensor(state["grid_passed"], dtype=torch.float32)
