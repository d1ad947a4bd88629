"""Distillation: one network from several, each gait from the policy that does it best.

As in imitation the student drives and its teachers name their actions (`hugwbc.learned.imitation.dagger`). The teachers
are policies, so a label costs almost nothing. Standing can have two teachers: one that is accurate while the robot is
at rest, and one that catches the robot when it moves. The label changes smoothly from one to the other.

A trained policy is often precise but biased: it turns at 0.8 of the commanded rate, or stands 3 cm too low. At the
beginning the teachers drive and are calibrated: for each gait and command, a curve says what to ask for so that the
executed value is the commanded one. The student learns the resulting actions under the original commands.
"""

import pathlib
from collections.abc import Collection, Mapping
from typing import Any

import torch

from hugwbc.commands import COMMAND_NAMES, command_ranges
from hugwbc.errors import ConfigError, PolicyFileError
from hugwbc.gait import Gait, hopping
from hugwbc.learned.config import CALIBRATED_COMMANDS, DistillationConfig
from hugwbc.learned.env.readings import Readings
from hugwbc.learned.imitation.dagger import Dagger
from hugwbc.learned.policy import checkpoint, observations
from hugwbc.learned.policy.networks import ACTION_SIZE, ActorCritic
from hugwbc.learned.policy.observations import Observation
from hugwbc.learned.policy.snapshots import network_of
from hugwbc.learned.policy.terms import TERMS

# Speed, angular velocity or roll (or a mixture) from which a standing robot is caught rather than held.
CATCH_SPEED, CATCH_ANGULAR_VELOCITY, CATCH_ROLL = 0.25, 1.2, 0.2  # [m/s], [rad/s], [rad]
_CATCH_SHARPNESS = 5.0
_COLUMNS = [COMMAND_NAMES.index(name) for name in CALIBRATED_COMMANDS]
_SETTLED = 1.0  # [s] after a change of command
_KNOTS = 7  # a line would not do: a policy may answer along a curve, such as a swing height that saturates
# Fraction of the error that is corrected per interval. The swing height is measured once per stride and often far off.
_RATES = torch.tensor([0.05] * 6 + [0.15])[:, None]
# Largest difference between a command and what is asked for: further away the policy was never trained. Swing heights
# may differ more, since policies answer them with a small slope, but steadily far beyond the range. Squats may differ
# little, since deeper ones topple.
_LARGEST_CHANGE = torch.tensor([0.3, 0.25, 0.3, 0.06, 0.1, 0.3, 0.8])[:, None]


def disturbance(readings: Readings) -> torch.Tensor:
    """Return how far robots are from rest, between 0 and 1, shape (n,); 0.5 at `CATCH_SPEED` alone."""
    motion = (
        torch.linalg.vector_norm(readings.velocity, dim=1) / CATCH_SPEED
        + torch.linalg.vector_norm(readings.angular_velocity, dim=1) / CATCH_ANGULAR_VELOCITY
        + readings.roll.abs() / CATCH_ROLL
    )
    return torch.sigmoid(_CATCH_SHARPNESS * (motion - 1.0))


def _knots() -> torch.Tensor:
    """Return the knots by value of `Gait` and calibrated command, shape (number of gaits, 7, knots)."""
    ranges = [[command_ranges(gait)[name].finishing for name in CALIBRATED_COMMANDS] for gait in Gait]
    low, high = torch.tensor(ranges, dtype=torch.float32).unbind(-1)
    share = torch.linspace(0.0, 1.0, _KNOTS)
    return low[..., None] + (high - low)[..., None] * share


class Calibration:
    """Curves of what to ask a policy for, so that it executes the original command.

    Attributes:
        knots: commands spread evenly over their ranges, by value of `Gait` and by v_x, v_y, omega, h, p, w, l, shape
            (number of gaits, 7, knots).
        asked: what to ask for at the knots, same shape; linear in between.
    """

    def __init__(self, calibrated: Collection[str] = CALIBRATED_COMMANDS) -> None:
        """Start with curves that change nothing.

        Args:
            calibrated: names of the commands that `update` may change.
        """
        self.knots = _knots()
        self.asked = self.knots.clone()
        chosen = torch.tensor([name in calibrated for name in CALIBRATED_COMMANDS])
        self._changeable = chosen & (self.knots[..., -1] > self.knots[..., 0])  # and commanded in the gait

    def _shares(self, command: torch.Tensor, gait: torch.Tensor) -> torch.Tensor:
        """Return the weight of each knot for a command, shape (n, 7, knots); at most two are not zero."""
        knots = self.knots[gait]
        spacing = (knots[..., 1:2] - knots[..., :1]).clamp_min(1e-6)
        position = ((command[:, _COLUMNS, None] - knots[..., :1]) / spacing).clamp(0.0, _KNOTS - 1.0)
        return (1.0 - (position - torch.arange(_KNOTS)).abs()).clamp_min(0.0)

    def commands(self, command: torch.Tensor, gait: torch.Tensor) -> torch.Tensor:
        """Return what to ask for, shape (n, 8), given commands (n, 8) and values of `Gait` (n,)."""
        asked = command.clone()
        change = (self.asked - self.knots)[gait]
        asked[:, _COLUMNS] += (self._shares(command, gait) * change).sum(-1)
        return asked

    def update(self, command: torch.Tensor, executed: torch.Tensor, gait: torch.Tensor) -> None:
        """Correct a fraction of the mean error around each knot.

        Args:
            command: original commands, shape (n, 8).
            executed: executed v_x, v_y, omega, h, p, w, l, shape (n, 7); NaN where unknown.
            gait: values of `Gait`, shape (n,).
        """
        known = executed.isfinite()
        error = torch.where(known, command[:, _COLUMNS] - executed, 0.0)
        shares = self._shares(command, gait) * known[..., None]
        for value in gait.unique().tolist():
            rows = gait == value
            weight = shares[rows].sum(0)
            mean = (shares[rows] * error[rows, :, None]).sum(0) / weight.clamp_min(1.0)
            self.asked[value] += torch.where(self._changeable[value, :, None], _RATES * mean, 0.0)
        change = (self.asked - self.knots).clamp(-_LARGEST_CHANGE, _LARGEST_CHANGE)
        self.asked = self.knots + change

    def as_dict(self) -> dict[str, dict[str, list[list[float]]]]:
        """Return the pairs of command and what is asked for, by gait and command, for the record."""
        pairs = torch.stack((self.knots, self.asked), dim=-1)
        return {
            gait.label: {
                name: [[round(value, 4) for value in pair] for pair in pairs[gait, i].tolist()]
                for i, name in enumerate(CALIBRATED_COMMANDS)
                if self._changeable[gait, i]
            }
            for gait in Gait
        }


class SwingHeights:
    """The highest clearance of the feet of every robot in its last stride.

    Attributes:
        last: mean over both feet [m], NaN before the first stride, shape (n,).
    """

    def __init__(self, count: int) -> None:
        """Start without a stride of any of `count` robots."""
        self.last = torch.full((count,), torch.nan)
        self._highest = torch.zeros(count, 2)
        self._phase = torch.zeros(count)

    def update(self, phase: torch.Tensor, clearance: torch.Tensor) -> None:
        """Add a control step: the common phases, shape (n,), and the clearances of the soles [m], shape (n, 2)."""
        begun = phase < self._phase
        self.last = torch.where(begun, self._highest.mean(1), self.last)
        self._highest = torch.where(begun[:, None], clearance, torch.maximum(self._highest, clearance))
        self._phase = phase.clone()


class Distiller(Dagger[DistillationConfig]):
    """DAgger with policies as teachers, one per gait.

    Attributes:
        calibration: calibration of the teachers.
    """

    interval = 10
    least_rate = 0.05

    def __init__(self, config: DistillationConfig) -> None:
        """Load the teachers and set up robots and student.

        Raises:
            ConfigError: if there is no network to start from, or the labels do not fit into memory.
            PolicyFileError: if a snapshot cannot be read.
        """
        self.teachers = {name: _load(path)[0].actor for name, path in config.teachers().items()}
        network, self._metadata = _load(config.start_from)
        super().__init__(config, network, config.memory)
        self.calibration = Calibration(config.calibrated_commands)
        self._swings = SwingHeights(config.env.count)
        self._arms = torch.as_tensor(self.env.robot.arms)

    def metadata(self, record: dict[str, Any]) -> dict[str, Any]:
        """Return what the policy and the snapshot say of their training: the student's past and this run."""
        own = {"labels": self.samples, "calibration": self.calibration.as_dict()}
        return self._metadata | {"distillation": own | record}

    def begin_leg(self, number: int) -> None:
        """Begin new episodes."""
        super().begin_leg(number)
        self._swings = SwingHeights(self.env.count)

    def state(self) -> dict[str, torch.Tensor]:
        """Return what the next leg needs besides the memory: the teachers' calibration as well."""
        return super().state() | {"asked": self.calibration.asked}

    def load_state(self, tensors: Mapping[str, torch.Tensor]) -> None:
        """Restore what `state` returned."""
        super().load_state(tensors)
        self.calibration.asked = tensors["asked"].clone()

    def loss(self, action: torch.Tensor, label: torch.Tensor) -> torch.Tensor:
        """Return the squared error."""
        return torch.nn.functional.mse_loss(action, label, reduction="none")

    @property
    def _calibrating(self) -> bool:
        return self.progress < self.config.calibration

    def _calibrate(self) -> None:
        r, env = self.env.readings, self.env
        swing = torch.where(env.gait == int(Gait.STANDING), torch.nan, self._swings.last)
        others = torch.stack((r.yaw_rate, r.height, r.pitch, r.q[:, env.robot.waist], swing), 1)
        executed = torch.cat((r.velocity[:, :2], others), 1)
        settled = env.command_time >= _SETTLED
        for name in self.teachers.keys() - set(self.config.calibrated):
            settled &= ~_of(env.gait, name)
        self.calibration.update(env.command[settled], executed[settled], env.gait[settled])

    def collect(self) -> int:
        """Advance all robots by one control step and store the labels; return how many robots fell."""
        env = self.env
        observation = env.observe()
        with torch.no_grad():
            label = self.label(observation)
        weight = torch.ones(env.count, ACTION_SIZE)
        # Arms under intervention do not follow the action, so what a teacher says about them is untested.
        weight[env.intervention.active.nonzero(), self._arms] = 0.0
        self._store(observation, label, weight)
        result = env.step(label if self._calibrating else self._own_action(observation) + self._exploration())
        self._swings.update(env.phase, env.readings.clearance)
        return int(result.done.sum()) - len(result.timed_out)

    def label(self, observation: Observation) -> torch.Tensor:
        """Return the action of each robot's teacher, shape (n, 19).

        Hops on the right leg are taught as mirror images of hops on the left leg. A policy hops a little differently on
        its two legs, and half of the student's samples are mirrored: taught both ways of hopping in every state, the
        student learned their mean, which kept the held foot on the ground.
        """
        gait = self.env.gait
        right = (gait == int(Gait.HOPPING_RIGHT))[:, None]
        label = torch.zeros(self.env.count, ACTION_SIZE)
        command = observation.command.clone()
        asked = self.calibration.commands(self.env.command, gait)
        command[:, : len(COMMAND_NAMES)] = asked * torch.tensor(TERMS["command"].scale)
        command = torch.where(right, observations.mirror_command_observation(command), command)
        history = torch.where(right, observations.mirror_history(observation.history), observation.history)
        for name, actor in self.teachers.items():
            rows = _of(gait, name).nonzero().squeeze(1)
            if rows.numel():
                action, _ = actor(history[rows], command[rows])
                if name == "catching":
                    share = disturbance(self.env.readings)[rows, None]
                    action = share * action + (1.0 - share) * label[rows]
                label[rows] = action
        return torch.where(right, observations.mirror_action(label), label)

    def fit(self) -> dict[str, float]:
        """Calibrate the teachers while they drive, and take gradient steps; return the mean losses."""
        if self._calibrating:
            self._calibrate()
        return super().fit()


def _of(gait: torch.Tensor, teacher: str) -> torch.Tensor:
    """Return which robots a teacher labels, shape (n,), bool."""
    if teacher == "hopping":
        return hopping(gait)
    return gait == int(Gait.STANDING if teacher == "catching" else Gait.parse(teacher))


def _load(path: pathlib.Path | None) -> tuple[ActorCritic, dict[str, object]]:
    if path is None:
        raise ConfigError("start_from is missing; give --start-from SNAPSHOT, the network that the student starts as")
    tensors, metadata = checkpoint.load_file(path, "checkpoint")
    prefix = "network."
    try:
        network = network_of({k[len(prefix) :]: v for k, v in tensors.items() if k.startswith(prefix)})
    except (RuntimeError, KeyError) as error:
        raise PolicyFileError(f"{path} has other networks than this version: {error}") from error
    return network, metadata
