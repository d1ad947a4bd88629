"""External control of the arms in training: when it happens, how it is blended in, its targets and the gains.

The paper's section on intervention training: I(t) flips with probability p per step, and while I = 1 the arms follow
alpha * target + (1 - alpha) * policy. The targets are the paper's noise (uniform, drawn every `NOISE_INTERVAL` steps
and approached linearly during the first two thirds of the interval) or motions, which each robot plays one after the
other with a fade between them.
"""

import pathlib
from collections.abc import Sequence

import numpy as np
import torch

from hugwbc.learned import PERIOD
from hugwbc.learned.env.randomization import rand, randint
from hugwbc.robot import Robot, load_mirror
from hugwbc.scripts.motion import ArmMotion, arm_noise_range, generate_motions, load_motions
from hugwbc.sim.batch import RobotBatch

NOISE_INTERVAL = 90  # control steps between two targets of the noise
RAMP_FRACTION = 2.0 / 3.0
FADE_STEPS = 25  # control steps over which a motion takes over from the posture before it


def _nominal_arms(robot: Robot, device: torch.device) -> torch.Tensor:
    return torch.tensor(robot.nominal[robot.arms], dtype=torch.float32, device=device)


class NoiseTargets:
    """The paper's noise: uniform targets over the range of `arm_noise_range`, approached linearly."""

    def __init__(
        self, robot: Robot, count: int, interval: int, generator: torch.Generator, paired: float = 0.0
    ) -> None:
        """Start from the nominal posture; a share `paired` of the draws is mirror-symmetric, as of arms that carry."""
        self.interval, self._paired = interval, paired
        device = generator.device
        # The partner of each arm joint, counted from 1, with the sign of the mirror.
        signed = load_mirror(robot).arms(1.0 + np.arange(len(robot.arms)), robot)
        self._partner = torch.as_tensor(np.abs(signed).astype(int) - 1, device=device)
        self._sign = torch.as_tensor(np.sign(signed), dtype=torch.float32, device=device)
        self._generator = generator
        self._low, self._high = (torch.tensor(b, dtype=torch.float32, device=device) for b in arm_noise_range(robot))
        self._nominal = _nominal_arms(robot, device)
        self._initial = self._nominal.repeat(count, 1)
        self._target = self._draw(count)
        self._age = randint(generator, interval, count)  # so that robots do not draw in step

    def _draw(self, count: int) -> torch.Tensor:
        arms = len(self._low)
        sample = rand(self._generator, count, arms)
        targets = self._low + sample * (self._high - self._low)
        if self._paired > 0.0:
            image = (targets[:, self._partner] * self._sign)[:, arms // 2 :]
            chosen = rand(self._generator, count) < self._paired
            targets[:, arms // 2 :] = torch.where(chosen[:, None], image, targets[:, arms // 2 :])
        return targets

    def reset(self, robots: torch.Tensor) -> None:
        """Restart robots (indices) from the nominal posture."""
        self._initial[robots] = self._nominal
        self._target[robots] = self._draw(robots.numel())
        self._age[robots] = 0

    def step(self) -> None:
        """Advance by one control step, and draw a new target where an interval has passed."""
        self._age += 1
        due = (self._age >= self.interval).nonzero().squeeze(1)
        if due.numel():
            self._initial[due] = self._target[due]
            self._target[due] = self._draw(due.numel())
            self._age[due] = 0

    def targets(self) -> torch.Tensor:
        """Return (1 - r) initial + r target [rad], (n, arm joints); r rises to 1 in two thirds of the interval."""
        ratio = (self._age / (RAMP_FRACTION * self.interval)).clamp(max=1.0)[:, None]
        return (1.0 - ratio) * self._initial + ratio * self._target

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return everything that a resumed run needs."""
        return {"initial": self._initial, "target": self._target, "age": self._age}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` returned; ignore the state of another kind of source."""
        if "target" in state:
            self._initial, self._target = state["initial"].clone(), state["target"].clone()
            self._age = state["age"].clone()


class MotionTargets:
    """Motions: each is played from a random frame to its end, and another one follows."""

    def __init__(
        self, robot: Robot, count: int, motions: Sequence[ArmMotion], generator: torch.Generator, period: float = PERIOD
    ) -> None:
        """Start at the nominal posture; motions of any rate are resampled to the control period [s]."""
        device = generator.device
        clips = [torch.tensor(motion.resampled(1.0 / period).positions, dtype=torch.float32) for motion in motions]
        self._frames = torch.cat(clips).to(device)
        self._length = torch.tensor([len(clip) for clip in clips], device=device)
        self._begin = self._length.cumsum(0) - self._length
        self._generator = generator
        self._nominal = _nominal_arms(robot, device)
        self._previous = self._nominal.repeat(count, 1)
        self._clip, self._frame, self._played = torch.zeros(3, count, dtype=torch.long, device=device)
        self._choose(torch.arange(count, device=device))

    def _choose(self, robots: torch.Tensor) -> None:
        clip = randint(self._generator, len(self._length), robots.numel())
        start = rand(self._generator, robots.numel()) * (self._length[clip] - 1)
        self._clip[robots], self._frame[robots], self._played[robots] = clip, start.long(), 0

    def reset(self, robots: torch.Tensor) -> None:
        """Restart robots (indices) from the nominal posture."""
        self._previous[robots] = self._nominal
        self._choose(robots)

    def step(self) -> None:
        """Advance by one control step, and choose another motion where one has ended."""
        self._frame += 1
        self._played += 1
        ended = (self._frame >= self._length[self._clip]).nonzero().squeeze(1)
        if ended.numel():
            last = self._begin[self._clip[ended]] + self._length[self._clip[ended]] - 1
            self._previous[ended] = self._frames[last]
            self._choose(ended)

    def targets(self) -> torch.Tensor:
        """Return the posture of the motion, faded in from the posture before it [rad], shape (n, arm joints)."""
        ratio = (self._played / FADE_STEPS).clamp(max=1.0)[:, None]
        return (1.0 - ratio) * self._previous + ratio * self._frames[self._begin[self._clip] + self._frame]

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return everything that a resumed run needs."""
        return {"previous": self._previous, "clip": self._clip, "frame": self._frame, "played": self._played}

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` returned; ignore the state of another source or of other motions."""
        if "clip" not in state or int(state["clip"].max()) >= len(self._length):
            return
        if bool((state["frame"] < self._length[state["clip"]]).all()):
            self._previous, self._clip = state["previous"].clone(), state["clip"].clone()
            self._frame, self._played = state["frame"].clone(), state["played"].clone()


ArmTargets = NoiseTargets | MotionTargets


def make_arm_targets(
    kind: str,
    robot: Robot,
    count: int,
    *,
    motions: pathlib.Path | None,
    motions_seed: int,
    generator: torch.Generator,
    paired: float = 0.0,
    period: float = PERIOD,
) -> ArmTargets:
    """Build the source of arm targets: for the kind "motion", those of a folder or generated ones; else the noise."""
    if kind != "motion":
        return NoiseTargets(robot, count, NOISE_INTERVAL, generator, paired)
    clips = generate_motions(robot, motions_seed) if motions is None else load_motions(motions, robot)
    return MotionTargets(robot, count, clips, generator, period)


class Intervention:
    """The intervention of n robots: its indicators and its targets.

    Attributes:
        eligible: whether the arms of each robot may be taken over now, shape (n,), bool.
        active: the paper's I(t), shape (n,), bool.
        source: source of the arm targets.
    """

    def __init__(
        self, eligible: torch.Tensor, flip_probability: float, source: ArmTargets, generator: torch.Generator
    ) -> None:
        """Start without intervention; `flip_probability` is that of I(t) in a control step."""
        self.eligible = eligible
        self.flip_probability = flip_probability
        self.active = torch.zeros_like(eligible)
        self.source = source
        self._generator = generator

    def reset(self, robots: torch.Tensor) -> None:
        """End the intervention of robots (indices); their arms start at the nominal posture."""
        self.active[robots] = False
        self.source.reset(robots)

    def step(self) -> None:
        """Flip the indicators and advance the targets."""
        flip = rand(self._generator, *self.active.shape) < self.flip_probability
        self.active = (self.active ^ flip) & self.eligible
        self.source.step()

    def blend(self, policy: torch.Tensor, alpha: float) -> torch.Tensor:
        """Return the policy's targets, where I = 1 blended with external ones by alpha [rad], shape (n, arm joints)."""
        blended = alpha * self.source.targets() + (1.0 - alpha) * policy
        return torch.where(self.active[:, None], blended, policy)

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return everything that a resumed run needs."""
        return {"active": self.active} | self.source.state_dict()

    def load_state_dict(self, state: dict[str, torch.Tensor]) -> None:
        """Restore what `state_dict` returned."""
        self.active = state["active"].clone()
        self.source.load_state_dict(state)


class ArmGains:
    """Stiffness and damping of the arm joints of n robots, between the policy's and the servo's.

    Under an intervention of noise level alpha the arms follow a mixture of external targets and the policy's, and their
    gains are the same mixture. The servo's feed-forward torque is left out: without it the arms sag by 2 degrees, and
    the pelvis bears the same weight.
    """

    def __init__(self, simulation: RobotBatch, robot: Robot) -> None:
        """Take the policy's gains from the robots; their random factors apply to the servo's as well."""
        self._arms = torch.as_tensor(robot.arms, device=simulation.device)
        self._gain = simulation.expand("actuator_gainprm")
        self._bias = simulation.expand("actuator_biasprm")
        # tau = k target + b_0 - k q - d dq; an offset of the target is b_0 / k.
        own = self._gain[:, self._arms, 0]
        bias = self._bias[:, self._arms]
        damping = -bias[..., 2]
        gains = robot.kp[robot.arms], robot.kd[robot.arms], robot.arm_kp, robot.arm_kd
        kp, kd, stiffness, servo_damping = map(simulation.tensor, gains)
        self._offset = bias[..., 0] / own
        self._own = own, damping
        self._servo = own / kp * stiffness, damping / kd * servo_damping
        self._share = own.new_zeros(len(own))

    def update(self, share: torch.Tensor) -> None:
        """Set the gains of the robots whose share of the servo, (n,), from 0 to 1, has changed."""
        wanted = share.to(self._share)
        rows = (wanted != self._share).nonzero().squeeze(1)
        if not rows.numel():
            return
        self._share = wanted
        part = wanted[rows, None]
        stiffness, damping = (
            (1.0 - part) * own[rows] + part * servo[rows] for own, servo in zip(self._own, self._servo, strict=True)
        )
        where = rows[:, None], self._arms
        self._gain[*where, 0] = stiffness
        self._bias[*where, 0] = stiffness * self._offset[rows]
        self._bias[*where, 1] = -stiffness
        self._bias[*where, 2] = -damping
