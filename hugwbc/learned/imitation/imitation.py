"""Imitation of a controller such as the whole-body QP, as a start for reinforcement learning."""

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
import torch

from hugwbc.commands import Command
from hugwbc.controller import JointCommand, UpperBody
from hugwbc.gait import Gait
from hugwbc.learned.config import ImitationConfig
from hugwbc.learned.env.curriculum import Curriculum
from hugwbc.learned.env.starts import STARTS_FILE, StartRecorder
from hugwbc.learned.env.terminations import held_foot_down
from hugwbc.learned.imitation.dagger import Dagger
from hugwbc.learned.policy.networks import ACTION_SIZE, ActorCritic
from hugwbc.learned.policy.records import settings_record
from hugwbc.learned.rl.cloning import LABELS_FILE, save_labels
from hugwbc.robot import Robot
from hugwbc.state import RobotState

ACTION_LIMIT = 12.0  # of a label in units of the action: in a fall the teacher may ask for anything
_AGREED = 0.5  # [s] for which robot and teacher must be in the commanded gait before the student may drive
_FIRST_OWN_TIME = 0.1  # [s], mean time that the student drives at the beginning
_RECORDED = 0.3  # fraction of the usable states to record: those of successive steps are nearly equal


class Teacher(Protocol):
    """A controller that advances the common phase of `hugwbc.gait` by itself."""

    @property
    def phase(self) -> float:
        """Phase of the control period of the last call of `act`, in [0, 1)."""
        ...

    @property
    def stepping(self) -> bool:
        """Whether the phase advances, which it does not in a stand or before the first step."""
        ...

    def reset(self, state: RobotState) -> None:
        """Forget the past."""
        ...

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """Return the joint command for the next period."""
        ...


def equivalent_targets(command: JointCommand, robot: Robot, damping: np.ndarray) -> np.ndarray:
    """Return position targets q* with which the policy's PD does what a joint command asks for [rad], shape (19,).

    kp (q* - q) - kd dq = tau + kp (q_d - q) + kd (dq_d - dq) for every q and dq gives q* = q_d + (tau + kd dq_d) / kp:
    feed-forward torque and motion of the command at the policy's stiffness instead of the command's.

    Args:
        command: joint command of the teacher.
        robot: the robot, with the policy's stiffness.
        damping: damping of the policy's PD [N*m*s/rad], shape (19,).
    """
    return command.q + (command.tau + damping * command.dq) / robot.kp


class Imitator(Dagger[ImitationConfig]):
    """DAgger with a controller per robot as the teacher."""

    interval = 40
    least_rate = 0.1

    def __init__(self, config: ImitationConfig, make_teacher: Callable[[float], Teacher]) -> None:
        """Set up robots, teachers and student.

        Args:
            config: the settings.
            make_teacher: builds a teacher for a control period [s]; called once per robot.

        Raises:
            ConfigError: if the labels do not fit into memory.
        """
        torch.manual_seed(config.seed)
        super().__init__(config, ActorCritic(config.std), round(config.samples))
        self._robot = self.env.robot
        self._make_teacher = make_teacher
        self._begin_teaching()
        self._starts = StartRecorder(config.starts)
        self._damping = config.env.damping(self._robot)

    def _begin_teaching(self) -> None:
        """Give every robot a new teacher, which drives it."""
        self._teachers = [self._make_teacher(self.env.dt) for _ in range(self.env.count)]
        for teacher, state in zip(self._teachers, self.env.simulation.states(), strict=True):
            teacher.reset(state)
        self._taught = torch.ones(self.env.count, dtype=torch.bool)
        self._agreed = torch.zeros(self.env.count)

    def write(self, seconds: float) -> None:
        """Write a policy, a snapshot to train from, states to start episodes in, and the labels.

        Args:
            seconds: how long it took [s], for the record.
        """
        super().write(seconds)
        if self.config.keep_labels:
            record = {"robot": self._robot.name, "config": settings_record(self.config)}
            save_labels(self.config.out / LABELS_FILE, self.memory.columns(), record)
        if self._starts.count:
            self._starts.save(self.config.out / STARTS_FILE)

    def begin_leg(self, number: int) -> None:
        """Begin new episodes, driven by teachers as far as they still drive."""
        super().begin_leg(number)
        self._begin_teaching()
        if number:
            self._restart(torch.arange(self.env.count))

    def state(self) -> dict[str, torch.Tensor]:
        """Return what the next leg needs besides the memory: the recorded states as well."""
        return super().state() | {f"starts.{name}": value for name, value in self._starts.columns().items()}

    def load_state(self, tensors: Mapping[str, torch.Tensor]) -> None:
        """Restore what `state` returned."""
        super().load_state(tensors)
        recorded = {key.partition(".")[2]: value for key, value in tensors.items() if key.startswith("starts.")}
        self._starts = StartRecorder(self.config.starts)
        if recorded:
            self._starts.add(recorded)

    def metadata(self, record: dict[str, Any]) -> dict[str, Any]:
        """Return what the policy and the snapshot say of their training: that it is at its beginning."""
        own = {
            "iteration": 0,
            "steps": self.samples,
            # The std is small to keep what was imitated; at a higher rate the first steps would undo it.
            "learning_rate": 1e-5,
            "skipped": 0,
            # The motion is regular already, so the penalties need not be eased in.
            "curriculum": Curriculum(self.config.env.curriculum).state_dict() | {"penalty_scale": 1.0},
        }
        return own | record

    def loss(self, action: torch.Tensor, label: torch.Tensor) -> torch.Tensor:
        """Return the smooth L1 loss, which tolerates the jumps of the teacher's torques when a foot comes down."""
        return torch.nn.functional.smooth_l1_loss(action, label, reduction="none")

    def collect(self) -> int:
        """Advance all robots by one control step and store the labels; return how many robots fell."""
        env = self.env
        label, weight = self._labels()
        self._record()
        observation = env.observe()
        own = self._own_action(observation)
        self._store(observation, label, weight)
        usable = weight.any(dim=1)
        action = torch.where((self._taught & usable)[:, None], label, own)
        result = env.step(action + self._exploration())
        fallen = result.done.clone()
        fallen[result.timed_out] = False
        self._hand_over()
        self._restart(result.done.nonzero().squeeze(1))
        return int(fallen.sum())

    def _record(self) -> None:
        """Record some of the states in which the teacher drives and the robot is in its gait."""
        if self._starts.full or self.progress >= self.config.handover:
            return
        sample = torch.rand(self.env.count, generator=self._generator) < _RECORDED
        rows = (sample & self._taught & (self._agreed >= _AGREED)).nonzero().squeeze(1)
        if rows.numel():
            self._starts.add(self.env.recorded(rows))

    def _hand_over(self) -> None:
        """Update for how long robots and teachers agree with the commanded gait; change drivers within the episode."""
        env, c = self.env, self.config
        down = held_foot_down(env.readings, env.gait)
        stepping = torch.tensor([teacher.stepping for teacher in self._teachers])
        agree = (stepping == (env.gait != int(Gait.STANDING))) & ~down
        self._agreed = torch.where(agree, self._agreed + env.dt, 0.0)
        if c.own_time == 0.0:
            return
        mean = _FIRST_OWN_TIME + min(self.progress / c.handover, 1.0) * (c.own_time - _FIRST_OWN_TIME)
        sample = torch.rand(env.count, generator=self._generator)
        given = self._taught & (self._agreed >= _AGREED) & (sample < env.dt / c.taught_time)
        taken = ~self._taught & (down | (sample < env.dt / mean))
        self._taught ^= given | taken

    def _restart(self, robots: torch.Tensor) -> None:
        """Choose the drivers of new episodes: the teacher drives fewer and fewer of them, or begins all of them."""
        if robots.numel():
            share = max(self.config.least_taught, 1.0 - self.progress / self.config.handover)
            by_share = torch.rand(robots.numel(), generator=self._generator) < share
            self._taught[robots] = by_share | (self.config.own_time > 0.0)
            self._agreed[robots] = 0.0
            states = self.env.simulation.states()
            for robot in robots.tolist():
                self._teachers[robot].reset(states[robot])

    def _labels(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the teachers' actions and the weight of each joint; robots take the phase of stepping teachers."""
        env, robot = self.env, self._robot
        arms, active = env.intervention.targets().double().numpy(), env.intervention.active.numpy()
        base = env.next_feed_forward().double().numpy()
        scale = self.config.env.action_scales(robot)
        labels = np.zeros((env.count, ACTION_SIZE))
        for i, state in enumerate(env.simulation.states()):
            command = Command.from_array(env.command[i].double().numpy(), Gait(int(env.gait[i])))
            upper_body = UpperBody.targets(arms[i]) if active[i] else UpperBody.none()
            joints = self._teachers[i].act(state, command, upper_body)
            labels[i] = equivalent_targets(joints, robot, self._damping) - robot.nominal - base[i]
            if self._teachers[i].stepping:  # otherwise the phase runs on as it does without a teacher
                env.phase[i] = self._teachers[i].phase
        actions = torch.from_numpy(labels / scale).float()
        weight = torch.ones_like(actions)
        # The legs carry the robot; arms and waist are easy and must not take up the network.
        weight[:, robot.arms] = self.config.upper_weight
        weight[:, robot.waist] = self.config.upper_weight
        weight[np.ix_(active, robot.arms)] = 0.0
        finite = torch.isfinite(actions).all(dim=1)
        weight[~finite] = 0.0
        actions[~finite] = 0.0
        return actions.clamp(-ACTION_LIMIT, ACTION_LIMIT), weight
