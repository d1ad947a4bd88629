"""Grid-adaptive speed curriculum: which combinations of v_x and omega the agile group is asked for.

Margolis et al., "Rapid Locomotion via Reinforcement Learning" (RSS 2022): the probability of a cell of the (v_x, omega)
plane grows when commands in it or next to it are tracked well. Walking and jumping have a grid each.
"""

import torch

from hugwbc.commands import command_ranges
from hugwbc.gait import Gait
from hugwbc.learned import distributed

GAITS = (Gait.WALKING, Gait.JUMPING)
CELLS = (13, 10)  # along v_x and omega
STEP = 0.2  # growth of a cell's weight, up to 1
_RANGES = [command_ranges(Gait.WALKING)[name].finishing for name in ("v_x", "omega")]
_LOW = torch.tensor([low for low, _ in _RANGES])
# 0.2 m/s and 0.2 rad/s
_SIZE = torch.tensor([(high - low) / cells for (low, high), cells in zip(_RANGES, CELLS, strict=True)])


class SpeedGrid:
    """Weights of the cells, and the judgements since the last update.

    Attributes:
        weight: relative probability of each cell, from 0 to 1, shape (gaits, 13, 10).
        passed: how often a command in each cell was tracked well since the last update, same shape.
    """

    def __init__(self, weight: torch.Tensor) -> None:
        """Start with given weights, shape (gaits, 13, 10)."""
        self.weight = weight
        self.passed = torch.zeros_like(weight)
        self._judged, self._failed, self._short = 0, 0, torch.zeros(2)

    @classmethod
    def up_to(cls, speed: float, yaw_rate: float) -> "SpeedGrid":
        """A grid with the cells whose centres lie within v_x <= `speed` [m/s] and |omega| <= `yaw_rate` [rad/s]."""
        v_x, omega = (_LOW[i] + (torch.arange(CELLS[i]) + 0.5) * _SIZE[i] for i in (0, 1))
        weight = ((v_x <= speed)[:, None] & (omega.abs() <= yaw_rate)).float().repeat(len(GAITS), 1, 1)
        return cls(weight)

    def draw(self, gait: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """Forward speeds and yaw rates, uniform within cells that are drawn by weight, shape (k, 2).

        Args:
            gait: values of `Gait`, walking or jumping, shape (k,).
            generator: of the draws.
        """
        weight = self.weight[(gait == Gait.JUMPING).long()].flatten(1)
        cell = torch.multinomial(weight, 1, generator=generator)
        place = torch.cat((cell // CELLS[1], cell % CELLS[1]), dim=1)
        return _LOW + (place + torch.rand(place.shape, generator=generator)) * _SIZE

    def judge(
        self, gait: torch.Tensor, command: torch.Tensor, tracking: torch.Tensor, thresholds: tuple[float, float]
    ) -> None:
        """Note how well some robots of the agile group tracked their command to its end.

        Args:
            gait: values of `Gait`, shape (k,); others than walking and jumping are left out.
            command: v_x and omega, shape (k, 2).
            tracking: linear and angular tracking reward relative to their maxima, shape (k, 2); 0 after a fall.
            thresholds: of the two.
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
        """Raise the weights of cells that were passed, and of their eight neighbours, in all processes alike."""
        counts = distributed.total(self.passed)
        spread = torch.nn.functional.conv2d(counts[:, None], torch.ones(1, 1, 3, 3), padding=1)[:, 0]
        self.weight = (self.weight + STEP * spread).clamp(max=1.0)
        self.passed = torch.zeros_like(self.weight)

    @property
    def max_speed(self) -> float:
        """Upper end of the fastest cell that walking is asked for [m/s]."""
        open_cells = (self.weight[0] > 0.0).any(1).nonzero()
        return float(_LOW[0] + (open_cells.max() + 1) * _SIZE[0])

    def report(self, thresholds: tuple[float, float]) -> str:
        """What was judged since the last call, in words.

        Args:
            thresholds: of the linear and angular tracking reward.
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
