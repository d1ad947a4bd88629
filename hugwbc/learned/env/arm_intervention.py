"""External upper-body intervention in training: switching and blending.

The paper's section on intervention training: I(t) flips with probability p per step; the arms follow
alpha * noise + (1 - alpha) * policy. Where the noise (or a motion) comes from is `hugwbc.learned.env.arm_targets`.
"""

import torch

from hugwbc.learned.env.arm_targets import ArmTargets


class Intervention:
    """State of the intervention of n robots.

    Attributes:
        eligible: robots that may be intervened now, shape (n,), bool.
        active: the paper's I(t), shape (n,), bool.
        alpha: noise level in [0, 1], common to all robots.
        source: of the arm targets.
    """

    def __init__(
        self, eligible: torch.Tensor, flip_probability: float, source: ArmTargets, generator: torch.Generator
    ) -> None:
        """Start without intervention.

        Args:
            eligible: robots that may be intervened, shape (n,), bool.
            flip_probability: of I(t), per step.
            source: of the arm targets.
            generator: of the flips.
        """
        self.eligible = eligible
        self.flip_probability = flip_probability
        self.alpha = 0.0
        self.active = torch.zeros(eligible.numel(), dtype=torch.bool)
        self.source = source
        self._generator = generator

    def reset(self, robots: torch.Tensor) -> None:
        """Forget the intervention of some robots (indices); their arms start at nominal."""
        self.active[robots] = False
        self.source.reset(robots)

    def step(self) -> None:
        """Flip indicators, and move the targets on."""
        flip = torch.rand(self.active.shape, generator=self._generator) < self.flip_probability
        self.active = (self.active ^ flip) & self.eligible
        self.source.step()

    def targets(self) -> torch.Tensor:
        """The external targets of the arms [rad], shape (n, 8)."""
        return self.source.targets()

    def blend(self, policy: torch.Tensor) -> torch.Tensor:
        """Arm targets that the joints receive [rad], shape (n, 8): external targets blended in where I = 1.

        Args:
            policy: the policy's arm targets [rad], shape (n, 8).
        """
        blended = self.alpha * self.targets() + (1.0 - self.alpha) * policy
        return torch.where(self.active[:, None], blended, policy)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything that a resumed run needs."""
        own = {"active": self.active, "alpha": torch.tensor(self.alpha, dtype=torch.float64)}
        return own | self.source.state_dict()

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` gave."""
        self.active = state["active"].clone()
        self.alpha = float(state["alpha"])
        self.source.load_state_dict(state)
