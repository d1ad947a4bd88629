"""Action latency: every robot's joint targets take effect some physics steps later, each robot's own number of them."""

import numpy as np
import torch

from hugwbc.sim.batch import BatchSimulation


class Latency:
    """The joint targets that are still under way.

    Attributes:
        delay: of each robot [physics steps], shape (n,).
        targets: joint targets, newest first [rad], shape (control steps kept, n, 19).
    """

    def __init__(self, delay: np.ndarray, substeps: int, joints: int) -> None:
        """Nothing is under way yet; call `reset` before the first step.

        Args:
            delay: of each robot [physics steps], shape (n,).
            substeps: physics steps in a control step.
            joints: number of joints.
        """
        self.delay = delay
        self._substeps = substeps
        self._robots = np.arange(len(delay))
        kept = 1 + int(self._age(0).max())
        self.targets = torch.zeros(kept, len(delay), joints, dtype=torch.float64)

    def _age(self, substep: int) -> np.ndarray:
        """How many control steps ago the target was given that acts in a physics step of the current one."""
        return np.maximum(-((substep - self.delay) // self._substeps), 0)

    def reset(self, robots: np.ndarray, target: np.ndarray) -> None:
        """Let a target have acted on some robots (indices) for ever [rad], shape (k, 19)."""
        self.targets[:, robots] = torch.from_numpy(target)

    def step(self, simulation: BatchSimulation) -> np.ndarray:
        """Advance the physics by a control step, the newest target being `simulation.ctrl`.

        Returns:
            Which robots diverged, shape (n,), bool.
        """
        newest = torch.from_numpy(simulation.ctrl.copy())
        self.targets = torch.cat((newest[None], self.targets[:-1]))
        targets = self.targets.numpy()
        diverged = np.zeros(len(self._robots), dtype=bool)
        for substep in range(self._substeps):
            simulation.ctrl[:] = targets[self._age(substep), self._robots]
            diverged |= simulation.step(1)
        simulation.ctrl[:] = targets[0]
        return diverged


def draw_delays(
    count: int, latency: tuple[float, float], timestep: float, rng: np.random.Generator
) -> np.ndarray | None:
    """Delays of robots in whole physics steps, shape (count,); None if none is above 0.

    Args:
        count: number of robots.
        latency: shortest and longest [s].
        timestep: of the physics [s].
        rng: of the draws.
    """
    if latency[1] == 0.0:
        return None
    return np.round(rng.uniform(*latency, count) / timestep).astype(int)
