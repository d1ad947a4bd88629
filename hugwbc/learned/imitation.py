"""A start for the reinforcement learning: imitate a teacher, such as the whole-body QP, on the student's own states.

DAgger (Ross, Gordon, Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning", AISTATS 2011): robots are driven by the student, after a beginning by the teacher; the teacher names the
action that it would take in every state, and the student is fitted to all of them. Cloning the teacher's own episodes
does not do: the student's first small errors lead to states that the teacher never visits.
"""

import dataclasses
import json
import time
from collections.abc import Callable
from typing import Protocol

import numpy as np
import torch

from hugwbc.commands import Command
from hugwbc.controller import JointCommand, UpperBody
from hugwbc.gait import Gait
from hugwbc.learned import observations as obs
from hugwbc.learned.config import DistillationConfig, ImitationConfig
from hugwbc.learned.contract import versions
from hugwbc.learned.curriculum import Curriculum
from hugwbc.learned.env import HumanoidEnv, Observation
from hugwbc.learned.networks import ACTION_SIZE, Actor, ActorCritic
from hugwbc.learned.train import save_product
from hugwbc.robot import Robot, load_robot
from hugwbc.state import RobotState

ACTION_LIMIT = 12.0  # of a label, in action units: in a fall the teacher may ask for anything
_INTERVAL = 40  # control steps between two rounds of fitting

Report = Callable[[dict[str, float]], None]


class Teacher(Protocol):
    """A controller that runs the common phase of `hugwbc.gait` by itself."""

    @property
    def phase(self) -> float:
        """The phase of the control period that the last call of `act` was for, in [0, 1)."""
        ...

    def reset(self, state: RobotState) -> None:
        """Forget the past."""
        ...

    def act(self, state: RobotState, command: Command, upper_body: UpperBody) -> JointCommand:
        """The joint command for the next period."""
        ...


def equivalent_targets(command: JointCommand, robot: Robot, damping: np.ndarray) -> np.ndarray:
    """Position targets that make the policy's PD do what a joint command asks for, shape (19,) [rad].

    kp (q* - q) - kd dq = tau + kp (q_d - q) + kd (dq_d - dq) for every q and dq, so q* = q_d + (tau + kd dq_d) / kp:
    the command's feed-forward and motion at the policy's stiffness instead of the command's.

    Args:
        command: the teacher's.
        robot: with the policy's stiffness.
        damping: the policy's [N*m*s/rad], shape (19,).
    """
    return command.q + (command.tau + damping * command.dq) / robot.kp


class Memory:
    """The newest labelled observations.

    Attributes:
        size: how many there are.
    """

    def __init__(self, capacity: int, generator: torch.Generator) -> None:
        """Reserve the memory.

        Args:
            capacity: largest number of samples.
            generator: of the batches.
        """
        self.size = 0
        self._next = 0
        self._generator = generator
        history = obs.HISTORY_FRAMES * obs.PROPRIOCEPTION_SIZE
        widths = {"history": history, "command": obs.COMMAND_SIZE, "estimate": obs.ESTIMATE_SIZE}
        widths |= {"action": ACTION_SIZE, "weight": ACTION_SIZE}
        self._columns = {name: torch.empty(capacity, width) for name, width in widths.items()}

    def add(self, observation: Observation, action: torch.Tensor, weight: torch.Tensor) -> None:
        """Store a row per robot: what it saw, the teacher's action (n, 19) and the weight of each joint (n, 19)."""
        capacity = len(self._columns["action"])
        rows = (self._next + torch.arange(len(action))) % capacity
        values = (observation.history, observation.command, observation.estimate, action, weight)
        for column, value in zip(self._columns.values(), values, strict=True):
            column[rows] = value
        self._next = int(rows[-1] + 1) % capacity
        self.size = min(self.size + len(action), capacity)

    def sample(self, count: int) -> dict[str, torch.Tensor]:
        """Random rows, half of them as their mirror images: what is right on the left is right on the right."""
        rows = torch.randint(self.size, (count,), generator=self._generator)
        batch = {name: column[rows] for name, column in self._columns.items()}
        half = count // 2
        for name, mirror in (
            ("history", obs.mirror_history),
            ("command", obs.mirror_command_observation),
            ("estimate", obs.mirror_estimate),
            ("action", obs.mirror_action),
            ("weight", lambda weight: obs.mirror_action(weight).abs()),
        ):
            batch[name][:half] = mirror(batch[name][:half])
        return batch


def fit_actor(
    actor: Actor,
    optimiser: torch.optim.Optimizer,
    memory: Memory,
    config: ImitationConfig | DistillationConfig,
    loss: Callable[..., torch.Tensor],
) -> dict[str, float]:
    """Gradient steps on random labels; returns the mean losses.

    Args:
        actor: the student.
        optimiser: of the actor's parameters.
        memory: the labels.
        config: with the number of steps, the batch's size and the weight of the estimation.
        loss: of each joint's error, such as `torch.nn.functional.mse_loss`; takes `reduction="none"`.
    """
    sums = {"imitation_loss": 0.0, "estimation_loss": 0.0}
    for _ in range(config.updates):
        batch = memory.sample(config.batch)
        mean, estimate = actor(batch["history"], batch["command"])
        l_imitation = (batch["weight"] * loss(mean, batch["action"], reduction="none")).mean()
        l_estimation = (estimate - batch["estimate"]).square().mean()
        optimiser.zero_grad()
        (l_imitation + config.estimation_weight * l_estimation).backward()
        torch.nn.utils.clip_grad_norm_(actor.parameters(), 1.0)
        optimiser.step()
        sums["imitation_loss"] += float(l_imitation.detach()) / config.updates
        sums["estimation_loss"] += float(l_estimation.detach()) / config.updates
    return sums


class Imitator:
    """Collects labels and fits the student.

    Attributes:
        env: the robots.
        network: the student; the critic is left as it starts.
        memory: the labels.
        samples: labels so far.
    """

    def __init__(self, config: ImitationConfig, make_teacher: Callable[[float], Teacher]) -> None:
        """Set up robots, teachers and student.

        Args:
            config: the settings.
            make_teacher: gives a teacher for a control period [s]; called once a robot.
        """
        torch.set_num_threads(config.threads)
        torch.manual_seed(config.seed)
        self.config = config
        self.env = HumanoidEnv(config.env, seed=config.seed, threads=config.threads)
        self.env.curriculum.alpha = config.noise_level
        self.env.curriculum.max_speed = config.max_speed
        self.network = ActorCritic(config.std)
        self.samples = 0
        self._robot = load_robot()
        self._generator = torch.Generator().manual_seed(config.seed)
        self.memory = Memory(round(config.samples), self._generator)
        self._teachers = [make_teacher(self.env.dt) for _ in range(self.env.count)]
        for teacher, state in zip(self._teachers, self.env.simulation.states(), strict=True):
            teacher.reset(state)
        self._taught = torch.ones(self.env.count, dtype=torch.bool)
        self._optimiser = torch.optim.Adam(self.network.actor.parameters(), lr=config.learning_rate)
        self._damping = config.env.damping(self._robot)

    @property
    def progress(self) -> float:
        """Part of the work that is done."""
        return self.samples / self.config.samples

    def run(self, report: Report) -> None:
        """Collect and fit until there are `config.samples` labels; writes a policy and a snapshot to train from."""
        begin = time.monotonic()
        while self.samples < self.config.samples:
            falls = sum(self.collect() for _ in range(_INTERVAL))
            losses = self.fit()
            report({"samples": self.samples, "falls": falls, "steps": _INTERVAL * self.env.count} | losses)
        metadata = {
            "iteration": 0,
            "steps": self.samples,
            "seconds": time.monotonic() - begin,
            # At the small std that keeps what was imitated, the first steps of a higher rate would undo it.
            "learning_rate": 1e-5,
            "skipped": 0,
            # The teacher's motion needs no easing-in of the penalties.
            "curriculum": Curriculum(self.config.env.curriculum).state_dict() | {"penalty_scale": 1.0},
            "versions": versions(),
            "config": json.loads(json.dumps(dataclasses.asdict(self.config), default=str)),
        }
        save_product(self.config.out, self.network, self.config.env, metadata)

    def collect(self) -> int:
        """One control step of all robots; returns how many fell."""
        env = self.env
        label, weight = self._labels()
        observation = env.observe()
        with torch.no_grad():
            own, _ = self.network.actor(observation.history, observation.command)
        self.memory.add(observation, label, weight)
        self.samples += env.count
        usable = weight.any(dim=1)
        action = torch.where((self._taught & usable)[:, None], label, own)
        noise = torch.randn(action.shape, generator=self._generator) * self.config.exploration
        result = env.step(action + noise)
        fallen = result.done.clone()
        fallen[result.timed_out] = False
        self._restart(result.done.nonzero().squeeze(1))
        return int(fallen.sum())

    def _restart(self, robots: torch.Tensor) -> None:
        """New episodes: the teacher drives fewer and fewer of them."""
        if robots.numel():
            share = max(self.config.least_taught, 1.0 - self.progress / self.config.handover)
            self._taught[robots] = torch.rand(robots.numel(), generator=self._generator) < share
            states = self.env.simulation.states()
            for robot in robots.tolist():
                self._teachers[robot].reset(states[robot])

    def _labels(self) -> tuple[torch.Tensor, torch.Tensor]:
        """The teachers' actions and the weight of each joint; robots take the phase of their teachers."""
        env, robot = self.env, self._robot
        arms, active = env.intervention.targets().double().numpy(), env.intervention.active.numpy()
        base = env.next_waist().numpy()
        scale = self.config.env.action_scales(robot)
        labels = np.zeros((env.count, ACTION_SIZE))
        for i, state in enumerate(env.simulation.states()):
            command = Command.from_array(env.command[i].double().numpy(), Gait(int(env.gait[i])))
            upper_body = UpperBody.targets(arms[i]) if active[i] else UpperBody.none()
            joints = self._teachers[i].act(state, command, upper_body)
            labels[i] = equivalent_targets(joints, robot, self._damping) - robot.nominal
            labels[i, robot.waist] -= base[i]
            env.phase[i] = self._teachers[i].phase
        actions = torch.from_numpy(labels / scale).float()
        weight = torch.ones_like(actions)
        # Legs carry the robot; arms and waist are easy and must not fill the network.
        weight[:, robot.arms] = self.config.upper_weight
        weight[:, robot.waist] = self.config.upper_weight
        weight[np.ix_(active, robot.arms)] = 0.0
        finite = torch.isfinite(actions).all(dim=1)
        weight[~finite] = 0.0
        actions[~finite] = 0.0
        return actions.clamp(-ACTION_LIMIT, ACTION_LIMIT), weight

    def fit(self) -> dict[str, float]:
        """Gradient steps on random labels; returns the mean losses."""
        c, actor = self.config, self.network.actor
        rate = c.learning_rate * max(0.1, 1.0 - self.progress)
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        return fit_actor(actor, self._optimiser, self.memory, c, torch.nn.functional.smooth_l1_loss)
