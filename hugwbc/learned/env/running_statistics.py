"""Running figures of the training: reward terms, tracking errors, episodes, and what moves the curricula."""

import math

import torch

from hugwbc.commands import COMMAND_NAMES
from hugwbc.gait import Gait
from hugwbc.learned import distributed
from hugwbc.learned.env.readings import TRACKED, Transition, tracked

TRACKING_MEMORY = 0.99  # per control step, of the exponential averages of the tracking rewards
_COLUMNS = [COMMAND_NAMES.index(name) for name in TRACKED]
GATES = ("alpha", "speed")
_MOVING = 0.1  # [m/s] and [rad/s] of a command, above which a robot counts as moving
_EVENTS = ("episodes", "falls", "diverged")


class Statistics:
    """Sums over control steps, and running averages of the tracking rewards of each robot.

    Attributes:
        tracking: exponential averages of the linear and angular tracking reward relative to their maxima, shape (n, 2).
    """

    def __init__(self, count: int, waist: int, *, hopping: bool = False) -> None:
        """Start empty.

        Args:
            count: number of robots.
            waist: index of the waist joint.
            hopping: whether to report the errors of hopping robots in addition to those of walking ones.
        """
        self.tracking = torch.zeros(count, 2)
        self._gates: dict[str, torch.Tensor] = {name: torch.zeros(2) for name in GATES}
        self._gaits = {"walking": (Gait.WALKING, Gait.WALKING), "jumping": (Gait.JUMPING, Gait.JUMPING)}
        if hopping:
            self._gaits["hopping"] = (Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT)
        self._waist = waist
        self._clear()

    def _clear(self) -> None:
        self._sums: dict[str, tuple[float, float]] = {}  # total and number of samples of each average
        self._events = dict.fromkeys(_EVENTS, 0.0)
        self._finished_steps = 0.0

    def add(
        self,
        rewards: dict[str, torch.Tensor],
        tracking: torch.Tensor,
        t: Transition,
        gait: torch.Tensor,
        finished_age: torch.Tensor,
        diverged: torch.Tensor,
    ) -> None:
        """Add a control step.

        Args:
            rewards: weighted terms, shape (n,) each.
            tracking: linear and angular tracking reward relative to their maxima, shape (n, 2).
            t: the transition.
            gait: values of `Gait`, shape (n,).
            finished_age: lengths of the episodes that ended [control steps], shape (number of episodes,).
            diverged: whether the physics of each robot failed, shape (n,), bool.
        """
        self.tracking = TRACKING_MEMORY * self.tracking + (1.0 - TRACKING_MEMORY) * torch.nan_to_num(tracking)
        for name, value in rewards.items():
            self._average(f"reward/{name}", float(value.mean()), 1.0)
        errors = (tracked(t, self._waist) - t.command[:, _COLUMNS]).abs()
        known = errors.isfinite().all(1)
        for label, (first, last) in self._gaits.items():
            robots = known & (gait >= first) & (gait <= last)
            for name, total in zip(TRACKED, errors[robots].sum(0).tolist(), strict=True):
                self._average(f"{label}_error/{name}", total, float(robots.sum()))
        happened = (finished_age.numel(), t.fallen.sum(), diverged.sum())
        for name, number in zip(_EVENTS, happened, strict=True):
            self._events[name] += float(number)
        self._finished_steps += float(finished_age.sum())

    def note_gate(self, name: str, tracking: torch.Tensor, robots: torch.Tensor) -> None:
        """Add a control step of the robots on which a gate depends to their running mean.

        Args:
            name: one of `GATES`.
            tracking: linear and angular tracking reward of all robots relative to their maxima, shape (n, 2).
            robots: the robots that count, shape (n,), bool; without any, the mean stays.
        """
        if bool(robots.any()):
            present = torch.nan_to_num(tracking[robots]).mean(0)
            self._gates[name] = TRACKING_MEMORY * self._gates[name] + (1.0 - TRACKING_MEMORY) * present

    def note_gates(
        self,
        tracking: torch.Tensor,
        command: torch.Tensor,
        gait: torch.Tensor,
        *,
        active: torch.Tensor,
        agile: torch.Tensor,
    ) -> None:
        """Note the tracking rewards of the robots on which the gates depend: those that walk somewhere.

        Standing robots track their zero velocity whatever the others do, and would hold a gate open.

        Args:
            tracking: as in `note_gate`.
            command: commands, shape (n, 8).
            gait: values of `Gait`, shape (n,).
            active: whose arms are under external control, shape (n,), bool.
            agile: which robots are of the agile group, shape (n,), bool.
        """
        walking = (command[:, :3].abs().amax(1) > _MOVING) & (gait == Gait.WALKING)
        self.note_gate("alpha", tracking, walking & active)
        self.note_gate("speed", tracking, walking & agile)

    def gate(self, name: str) -> tuple[float, float]:
        """Return the running means of the linear and angular tracking reward of a gate, over all processes."""
        linear, angular = distributed.mean(self._gates[name]).tolist()
        return linear, angular

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return the running averages."""
        return {"tracking": self.tracking} | {f"gate_{name}": value for name, value in self._gates.items()}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` returned."""
        self.tracking = state["tracking"].clone()
        self._gates = {name: state[f"gate_{name}"].clone() for name in GATES}

    def add_share(self, name: str, flag: torch.Tensor, robots: torch.Tensor) -> None:
        """Add the share of the chosen robots whose flag is set; both arguments have shape (n,), bool."""
        self._average(name, float((flag & robots).sum()), float(robots.sum()))

    def _average(self, name: str, total: float, count: float) -> None:
        before, samples = self._sums.get(name, (0.0, 0.0))
        # A total that is not finite comes from a robot whose physics failed: leave it out.
        self._sums[name] = (before + total, samples + count) if math.isfinite(total) else (before, samples)

    def pop(self) -> dict[str, float]:
        """Return and clear the averages (NaN without samples), event counts and mean episode length."""
        result = {name: total / count if count else math.nan for name, (total, count) in self._sums.items()}
        episodes = self._events["episodes"]
        result |= self._events | {"episode_length": self._finished_steps / episodes if episodes else math.nan}
        self._clear()
        return result
