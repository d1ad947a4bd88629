"""Running figures of the training: reward terms, tracking errors, episodes, and what moves the curricula."""

import math
from collections.abc import Sequence

import torch

from hugwbc.commands import MEASURED_NAMES
from hugwbc.gait import Gait, hopping
from hugwbc.learned import distributed
from hugwbc.learned.env.readings import Transition, command_errors, held_foot_down

TRACKING_MEMORY = 0.99  # per control step, of the exponential averages of the tracking rewards
GATES = ("alpha", "speed")
_MOVING = 0.1  # [m/s] and [rad/s] of a command, above which a robot counts as moving
_GAITS = {  # first and last value of `Gait`
    "walking": (Gait.WALKING, Gait.WALKING),
    "jumping": (Gait.JUMPING, Gait.JUMPING),
    "hopping": (Gait.HOPPING_LEFT, Gait.HOPPING_RIGHT),
}
_EVENTS, _LENGTH = ("episodes", "falls", "diverged"), "episode_length"


class Statistics:
    """Sums over control steps, and running averages of the tracking rewards of each robot.

    Attributes:
        tracking: exponential averages of the linear and angular tracking reward relative to their maxima, shape (n, 2).
    """

    def __init__(self, agile: torch.Tensor, waist: int) -> None:
        """Start empty.

        Args:
            agile: which robots are of the agile group, shape (n,), bool. The sums stay on its device until `pop`.
            waist: index of the waist joint.
        """
        self._agile, self._waist = agile, waist
        self.tracking = torch.zeros(len(agile), 2, device=agile.device)
        self._gates: dict[str, torch.Tensor] = {name: torch.zeros(2, device=agile.device) for name in GATES}
        self._sums: dict[tuple[str, ...], torch.Tensor] = {}  # totals, numbers of samples: shape (2, number of names)
        self._not_finite: dict[tuple[str, ...], torch.Tensor] = {}  # numbers of rewards, by their names

    def add(
        self,
        rewards: dict[str, torch.Tensor],
        tracking: torch.Tensor,
        t: Transition,
        finished_age: torch.Tensor,
        diverged: torch.Tensor,
    ) -> None:
        """Add a control step.

        Args:
            rewards: weighted terms, shape (n,) each.
            tracking: linear and angular tracking reward relative to their maxima, shape (n, 2).
            t: the transition.
            finished_age: lengths of the episodes that ended [control steps], shape (number of episodes,).
            diverged: whether the physics of each robot failed, shape (n,), bool.
        """
        self.tracking = TRACKING_MEMORY * self.tracking + (1.0 - TRACKING_MEMORY) * torch.nan_to_num(tracking)
        values, names = torch.stack(tuple(rewards.values())), tuple(rewards)
        wrong = (~values.isfinite() & ~diverged).sum(1)
        self._not_finite[names] = self._not_finite[names] + wrong if names in self._not_finite else wrong
        terms = values.double().mean(1)
        self._average([f"reward/{name}" for name in rewards], terms, torch.ones_like(terms))
        errors = command_errors(t, t.command, self._waist)
        known = errors.isfinite().all(1)
        for label, (first, last) in _GAITS.items():
            robots = known & (t.gait >= first) & (t.gait <= last)
            totals = torch.where(robots[:, None], errors, 0.0).double().sum(0)
            self._average([f"{label}_error/{name}" for name in MEASURED_NAMES], totals, robots.sum().expand_as(totals))
        happened = (finished_age.new_tensor(finished_age.numel()), t.fallen.sum(), diverged.sum(), finished_age.sum())
        self._average([*_EVENTS, _LENGTH], torch.stack(happened).double(), torch.ones_like(happened[1]).expand(4))
        self._average(["held_foot_down"], held_foot_down(t, t.gait).sum()[None].double(), hopping(t.gait).sum()[None])
        # Standing robots track their zero velocity whatever the others do, and would hold a gate open.
        walking = (t.command[:, :3].abs().amax(1) > _MOVING) & (t.gait == Gait.WALKING)
        self.note_gate("alpha", tracking, walking & t.intervention)
        self.note_gate("speed", tracking, walking & self._agile)

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

    def gate(self, name: str) -> tuple[float, float]:
        """Return the running means of the linear and angular tracking reward of a gate, over all processes."""
        linear, angular = distributed.mean(self._gates[name]).tolist()
        return linear, angular

    def set_gates(self, **known: tuple[float, float] | None) -> None:
        """Let the running means of gates go on from values that `gate` returned; None leaves a mean as it is."""
        for name, value in known.items():
            if value is not None:
                self._gates[name] = self._gates[name].new_tensor(value)

    def faults(self) -> str:
        """Return in words which rewards were not finite since the last call; empty if none. On a GPU it waits.

        Those of robots whose physics failed do not count.
        """
        counts: dict[str, int] = {}
        for names, numbers in self._not_finite.items():
            for name, number in zip(names, numbers.tolist(), strict=True):
                counts[name] = counts.get(name, 0) + number
        self._not_finite = {}
        found = ", ".join(f"{count} of {name}" for name, count in counts.items() if count)
        return f"not finite, counted as 0: {found}" if found else ""

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return the running averages."""
        return {"tracking": self.tracking} | {f"gate_{name}": value for name, value in self._gates.items()}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` returned."""
        self.tracking = state["tracking"].clone()
        self._gates = {name: state[f"gate_{name}"].clone() for name in GATES}

    def _average(self, names: Sequence[str], totals: torch.Tensor, counts: torch.Tensor) -> None:
        """Add totals over some samples, shape (number of names,) each, on the device and without waiting for it."""
        # A total that is not finite comes from a robot whose physics failed, or from a user's reward: leave it out.
        finite = totals.isfinite()
        added = torch.stack((torch.where(finite, totals, 0.0), torch.where(finite, counts, 0)))
        key = tuple(names)
        self._sums[key] = self._sums[key] + added if key in self._sums else added

    def pop(self) -> dict[str, float]:
        """Return and clear the averages (NaN without samples), event counts and mean episode length."""
        sums: dict[str, tuple[float, float]] = {}
        for names, values in self._sums.items():
            sums |= dict(zip(names, values.T.tolist(), strict=True))
        self._sums = {}
        events = {name: sums.pop(name, (0.0, 0.0))[0] for name in (*_EVENTS, _LENGTH)}
        steps, episodes = events.pop(_LENGTH), events["episodes"]
        result = {name: total / count if count else math.nan for name, (total, count) in sums.items()}
        return result | events | {_LENGTH: steps / episodes if episodes else math.nan}
