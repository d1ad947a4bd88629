"""External upper-body intervention in training: switching, interpolated noise targets, and blending.

The paper's section on intervention training: I(t) flips with probability p per step; arm targets are drawn uniformly
every t_interval steps and approached linearly during the first two thirds of the interval; the arms follow
alpha * noise + (1 - alpha) * policy.
"""

import torch

from hugwbc.robot import load_robot

RAMP_FRACTION = 2.0 / 3.0
# Uniform arm targets [rad] of the left arm; the right arm's are their mirror image (the authors' ranges).
_LEFT_RANGES = {
    "shoulder_pitch": (-2.6, 2.6),
    "shoulder_roll": (-0.3, 3.0),
    "shoulder_yaw": (-1.2, 4.3),
    "elbow": (-1.2, 2.5),
}
_MIRRORED = ("shoulder_roll", "shoulder_yaw")


def noise_ranges() -> tuple[torch.Tensor, torch.Tensor]:
    """Lower and upper arm targets in the order of `Robot.arm_names` [rad], each of shape (8,)."""
    low, high = [], []
    for name in load_robot().arm_names:
        side, part = name.removesuffix("_joint").split("_", 1)
        a, b = _LEFT_RANGES[part]
        if side == "right" and part in _MIRRORED:
            a, b = -b, -a
        low.append(a)
        high.append(b)
    return torch.tensor(low), torch.tensor(high)


class Intervention:
    """State of the intervention of n robots.

    Attributes:
        eligible: robots that may be intervened now, shape (n,), bool.
        active: the paper's I(t), shape (n,), bool.
        alpha: noise level in [0, 1], common to all robots.
    """

    def __init__(
        self, eligible: torch.Tensor, flip_probability: float, interval: int, generator: torch.Generator
    ) -> None:
        """Start without intervention.

        Args:
            eligible: robots that may be intervened, shape (n,), bool.
            flip_probability: of I(t), per step.
            interval: steps between two draws of the targets.
            generator: of all random numbers.
        """
        count = eligible.numel()
        self.eligible = eligible
        self.flip_probability = flip_probability
        self.interval = interval
        self.alpha = 0.0
        self.active = torch.zeros(count, dtype=torch.bool)
        self._generator = generator
        self._low, self._high = noise_ranges()
        robot = load_robot()
        self._nominal = torch.tensor(robot.nominal[robot.arms], dtype=torch.float32)
        self._initial = self._nominal.repeat(count, 1)
        self._target = self._draw(count)
        # Spread over the interval, so that the robots' draws do not coincide.
        self._age = torch.randint(interval, (count,), generator=generator)

    def _draw(self, count: int) -> torch.Tensor:
        sample = torch.rand((count, 8), generator=self._generator)
        return self._low + sample * (self._high - self._low)

    def reset(self, robots: torch.Tensor) -> None:
        """Forget the intervention of some robots (indices); their arms start at nominal."""
        self.active[robots] = False
        self._initial[robots] = self._nominal
        self._target[robots] = self._draw(robots.numel())
        self._age[robots] = 0

    def step(self) -> None:
        """Flip indicators and draw new targets where an interval has passed."""
        flip = torch.rand(self.active.shape, generator=self._generator) < self.flip_probability
        self.active = (self.active ^ flip) & self.eligible
        self._age += 1
        due = (self._age >= self.interval).nonzero().squeeze(1)
        if due.numel():
            self._initial[due] = self._target[due]
            self._target[due] = self._draw(due.numel())
            self._age[due] = 0

    def targets(self) -> torch.Tensor:
        """The interpolated noise targets of the arms [rad], shape (n, 8): (1 - r) initial + r target."""
        ratio = (self._age / (RAMP_FRACTION * self.interval)).clamp(max=1.0)[:, None]
        return (1.0 - ratio) * self._initial + ratio * self._target

    def blend(self, policy: torch.Tensor) -> torch.Tensor:
        """Arm targets that the joints receive [rad], shape (n, 8): noise blended in where I = 1.

        Args:
            policy: the policy's arm targets [rad], shape (n, 8).
        """
        blended = self.alpha * self.targets() + (1.0 - self.alpha) * policy
        return torch.where(self.active[:, None], blended, policy)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything that a resumed run needs."""
        return {
            "active": self.active,
            "initial": self._initial,
            "target": self._target,
            "age": self._age,
            "alpha": torch.tensor(self.alpha, dtype=torch.float64),
        }

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` gave."""
        self.active = state["active"].clone()
        self._initial, self._target = state["initial"].clone(), state["target"].clone()
        self._age = state["age"].clone()
        self.alpha = float(state["alpha"])
