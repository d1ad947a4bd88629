"""Arm targets of the intervention, for many robots at once: the paper's noise, or motions.

Noise: uniform targets every t_interval steps, approached linearly during the first two thirds of the interval (the
paper's section on intervention training). Motions: each robot plays one after the other, faded into each other.
"""

import pathlib
from collections.abc import Sequence
from typing import Protocol

import torch

from hugwbc.robot import load_robot
from hugwbc.scripts.motion import ArmMotion, arm_noise_range, generate_motions, load_motions

RAMP_FRACTION = 2.0 / 3.0
FADE_STEPS = 25  # control steps over which a motion takes over from the posture before it
_ARMS = 8


class ArmTargets(Protocol):
    """A source of arm targets for n robots, one call of `step` per control step."""

    def reset(self, robots: torch.Tensor) -> None:
        """Start some robots (indices) anew, from the nominal posture."""
        ...

    def step(self) -> None:
        """Go on by one control step."""
        ...

    def targets(self) -> torch.Tensor:
        """Order of `Robot.arm_names` [rad], shape (n, 8)."""
        ...

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything that a resumed run needs."""
        ...

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` gave; what another kind of source has stored is ignored."""
        ...


def _nominal_arms(count: int) -> torch.Tensor:
    robot = load_robot()
    return torch.tensor(robot.nominal[robot.arms], dtype=torch.float32).repeat(count, 1)


class NoiseTargets:
    """Uniform noise over the range of `arm_noise_range`, interpolated."""

    def __init__(self, count: int, interval: int, generator: torch.Generator) -> None:
        """Start at nominal.

        Args:
            count: number of robots.
            interval: steps between two draws of the targets.
            generator: of the draws.
        """
        self.interval = interval
        self._generator = generator
        self._low, self._high = (torch.tensor(bound, dtype=torch.float32) for bound in arm_noise_range())
        self._initial = _nominal_arms(count)
        self._target = self._draw(count)
        self._age = torch.randint(interval, (count,), generator=generator)  # spread, until a robot's first reset

    def _draw(self, count: int) -> torch.Tensor:
        sample = torch.rand((count, _ARMS), generator=self._generator)
        return self._low + sample * (self._high - self._low)

    def reset(self, robots: torch.Tensor) -> None:
        """Start some robots (indices) anew, from the nominal posture."""
        self._initial[robots] = _nominal_arms(robots.numel())
        self._target[robots] = self._draw(robots.numel())
        self._age[robots] = 0

    def step(self) -> None:
        """Go on by one control step; new targets where an interval has passed."""
        self._age += 1
        due = (self._age >= self.interval).nonzero().squeeze(1)
        if due.numel():
            self._initial[due] = self._target[due]
            self._target[due] = self._draw(due.numel())
            self._age[due] = 0

    def targets(self) -> torch.Tensor:
        """(1 - r) initial + r target, r rising to 1 in two thirds of the interval [rad], shape (n, 8)."""
        ratio = (self._age / (RAMP_FRACTION * self.interval)).clamp(max=1.0)[:, None]
        return (1.0 - ratio) * self._initial + ratio * self._target

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything that a resumed run needs."""
        return {"initial": self._initial, "target": self._target, "age": self._age}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` gave; what another kind of source has stored is ignored."""
        if "target" in state:
            self._initial, self._target = state["initial"].clone(), state["target"].clone()
            self._age = state["age"].clone()


class MotionTargets:
    """Motions, each from a random frame to its end; then another."""

    def __init__(self, count: int, motions: Sequence[ArmMotion], generator: torch.Generator) -> None:
        """Start at nominal.

        Args:
            count: number of robots.
            motions: at any rate; they are resampled to the control rate.
            generator: of the choices.
        """
        clips = [torch.tensor(motion.resampled().positions, dtype=torch.float32) for motion in motions]
        self._frames = torch.cat(clips)
        self._length = torch.tensor([len(clip) for clip in clips])
        self._begin = self._length.cumsum(0) - self._length
        self._generator = generator
        self._previous = _nominal_arms(count)
        self._clip = torch.zeros(count, dtype=torch.long)
        self._frame = torch.zeros(count, dtype=torch.long)
        self._played = torch.zeros(count, dtype=torch.long)
        self._choose(torch.arange(count))

    def _choose(self, robots: torch.Tensor) -> None:
        clip = torch.randint(len(self._length), (robots.numel(),), generator=self._generator)
        start = torch.rand(robots.numel(), generator=self._generator) * (self._length[clip] - 1)
        self._clip[robots], self._frame[robots], self._played[robots] = clip, start.long(), 0

    def reset(self, robots: torch.Tensor) -> None:
        """Start some robots (indices) anew, from the nominal posture."""
        self._previous[robots] = _nominal_arms(robots.numel())
        self._choose(robots)

    def step(self) -> None:
        """Go on by one control step; another motion where one has ended."""
        self._frame += 1
        self._played += 1
        ended = (self._frame >= self._length[self._clip]).nonzero().squeeze(1)
        if ended.numel():
            last = self._begin[self._clip[ended]] + self._length[self._clip[ended]] - 1
            self._previous[ended] = self._frames[last]
            self._choose(ended)

    def targets(self) -> torch.Tensor:
        """The motion's posture, faded in from the one before it [rad], shape (n, 8)."""
        ratio = (self._played / FADE_STEPS).clamp(max=1.0)[:, None]
        return (1.0 - ratio) * self._previous + ratio * self._frames[self._begin[self._clip] + self._frame]

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Everything that a resumed run needs."""
        return {"previous": self._previous, "clip": self._clip, "frame": self._frame, "played": self._played}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` gave; another source's state, or that of other motions, is ignored."""
        if "clip" not in state or int(state["clip"].max()) >= len(self._length):
            return
        if bool((state["frame"] < self._length[state["clip"]]).all()):
            self._previous, self._clip = state["previous"].clone(), state["clip"].clone()
            self._frame, self._played = state["frame"].clone(), state["played"].clone()


def make_arm_targets(
    kind: str,
    count: int,
    *,
    interval: int,
    motions: pathlib.Path | None,
    motions_seed: int,
    generator: torch.Generator,
) -> ArmTargets:
    """The source of arm targets that an intervention has, in training and in evaluation.

    Args:
        kind: "motion", or anything else for noise, which does no harm where nothing is intervened.
        count: number of robots.
        interval: control steps between two draws of the noise.
        motions: folder of motion files; None for generated motions.
        motions_seed: of the generated ones.
        generator: of the draws.

    Raises:
        MotionFileError: if the motion files cannot be used.
    """
    if kind != "motion":
        return NoiseTargets(count, interval, generator)
    clips = generate_motions(motions_seed) if motions is None else load_motions(motions)
    return MotionTargets(count, clips, generator)
