"""Curricula of the training: penalty scale, intervention noise level, speed of the agile group.

Every gate says why it is closed. All state is in `state_dict`.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import torch

from hugwbc.commands import COMMAND_NAMES, command_ranges
from hugwbc.gait import Gait
from hugwbc.learned.config import CurriculumConfig
from hugwbc.learned.env.speed_grid import SpeedGrid

_RANGES = command_ranges(Gait.WALKING)
# Largest v_x [m/s] and omega [rad/s] at the start and at the end.
MAX_SPEED, MAX_YAW_RATE = ((_RANGES[name].initial[1], _RANGES[name].finishing[1]) for name in ("v_x", "omega"))
SPEED_COLUMNS = [COMMAND_NAMES.index("v_x"), COMMAND_NAMES.index("omega")]  # of a command, that the grid draws


@dataclasses.dataclass
class Curriculum:
    """Levels that move once per iteration.

    Attributes:
        config: thresholds and steps.
        iteration: iterations seen.
        penalty_scale: factor on the regularisation rewards.
        alpha: noise level of the intervention.
        max_speed: largest v_x of the agile group [m/s].
        grid: speeds of the agile group by cell; None if they have one range.
        gates: for each curriculum, what its gate decided last, in words.
    """

    config: CurriculumConfig
    iteration: int = 0
    penalty_scale: float = dataclasses.field(init=False)
    alpha: float = 0.0
    max_speed: float = MAX_SPEED[0]
    grid: SpeedGrid | None = dataclasses.field(init=False)
    gates: dict[str, str] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Start at the configured penalty, and at the paper's initial speeds."""
        self.penalty_scale = self.config.penalty_start
        self.grid = SpeedGrid.up_to(MAX_SPEED[0], MAX_YAW_RATE[0]) if self.config.speed == "grid" else None

    @property
    def max_yaw_rate(self) -> float:
        """Largest |omega| of the agile group [rad/s]: grows in proportion with the speed."""
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
            agile: mean linear and angular tracking reward of the agile group, relative to their maxima; None where
                there is none.
            intervened: the same of the intervention group; None where there is no intervention.
            terrain_mastered: whether the terrain's level lets noise and speed move.
        """
        self.iteration += 1
        if self.iteration <= self.config.warm_up_iterations:
            self.gates = dict.fromkeys(("penalty", "alpha", "speed"), f"warm-up until {self.config.warm_up_iterations}")
            return
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
        """The paper's rule: up when both rewards exceed their thresholds, down below two thirds of either."""
        thresholds = {"linear": self.config.linear_threshold, "angular": self.config.angular_threshold}
        values = {"linear": linear, "angular": angular}
        short = [
            f"{n} velocity reward {values[n]:.2f} < {thresholds[n]:.2f}" for n in values if values[n] < thresholds[n]
        ]
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
        """Tell the speed grid, if there is one, how commands of the agile group went that have ended.

        Args:
            gait: values of `Gait`, shape (k,).
            command: in the order of `COMMAND_NAMES`, shape (k, 8).
            tracking: linear and angular tracking reward relative to their maxima, shape (k, 2); 0 after a fall.
        """
        if self.grid is not None:
            self.grid.judge(gait, command[:, SPEED_COLUMNS], tracking, self.speed_thresholds)

    @property
    def speed_thresholds(self) -> tuple[float, float]:
        """Linear and angular tracking reward that open a cell of the grid."""
        return self.config.speed_threshold, self.config.speed_angular_threshold

    def _update_grid(self, grid: SpeedGrid) -> None:
        grid.update()
        self.max_speed = grid.max_speed
        self.gates["speed"] = grid.report(self.speed_thresholds)

    def state_dict(self) -> dict[str, Any]:
        """The levels, as JSON can hold them."""
        state: dict[str, Any] = {
            name: getattr(self, name) for name in ("iteration", "penalty_scale", "alpha", "max_speed")
        }
        if self.grid is not None:
            state |= {"grid": self.grid.weight.tolist(), "grid_passed": self.grid.passed.tolist()}
        return state

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore the levels; a grid that another kind of curriculum has not stored starts from the speed reached."""
        self.iteration = int(state["iteration"])
        self.penalty_scale, self.alpha, self.max_speed = (
            float(state[name]) for name in ("penalty_scale", "alpha", "max_speed")
        )
        if self.grid is not None:
            self.grid = SpeedGrid.up_to(self.max_speed, self.max_yaw_rate)
            if "grid" in state:
                self.grid.weight = torch.tensor(state["grid"], dtype=torch.float32)
            if "grid_passed" in state:  # checkpoints from before it was kept lack it
                self.grid.passed = torch.tensor(state["grid_passed"], dtype=torch.float32)
