"""Recording of starts: another controller, such as the QP, drives robots, and episodes can start in its states.

The controller's joint commands become actions of the policy's kind, so that a recorded state holds what the policy
would have seen and done in it.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np
import torch

from hugwbc.commands import Command
from hugwbc.controller import JointCommand, UpperBody
from hugwbc.errors import ConfigError
from hugwbc.gait import Gait
from hugwbc.learned.config import RecordConfig
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.env.starts import StartRecorder
from hugwbc.learned.env.terminations import held_foot_down
from hugwbc.robot import Robot
from hugwbc.state import RobotState

ACTION_LIMIT = 12.0  # in a fall the controller may ask for anything
_AGREED = 0.5  # [s] for which robot and controller must be in the commanded gait before a state is recorded
_RECORDED = 0.3  # fraction of the usable states to record: those of successive steps are nearly equal
_MOST_STEPS = 40  # of the robots for each state to record; a controller that needs more keeps falling


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
    """Return position targets q* with which the policy's PD does what a joint command asks for [rad], shape (joints,).

    kp (q* - q) - kd dq = tau + kp (q_d - q) + kd (dq_d - dq) for every q and dq gives q* = q_d + (tau + kd dq_d) / kp:
    feed-forward torque and motion of the command at the policy's stiffness instead of the command's.

    Args:
        command: joint command of the controller.
        robot: the robot, with the policy's stiffness.
        damping: damping of the policy's PD [N*m*s/rad], shape (joints,).
    """
    return command.q + (command.tau + damping * command.dq) / robot.kp


def record_starts(
    config: RecordConfig, make_teacher: Callable[[float], Teacher], report: Callable[[float], None]
) -> StartRecorder:
    """Let a controller drive the robots, and record states in which robot and controller are in the commanded gait.

    Args:
        config: the settings.
        make_teacher: builds a controller for a control period [s]; called once per robot.
        report: called after every control step with the fraction that is done.
    """
    torch.set_num_threads(config.threads)
    env = HumanoidEnv(config.env, seed=config.seed, threads=config.threads)
    # Nobody updates the curriculum here: its levels stay as they are set.
    env.curriculum.alpha, env.curriculum.max_speed = config.noise_level, config.max_speed
    generator = torch.Generator().manual_seed(config.seed)
    teachers = [make_teacher(env.dt) for _ in range(env.count)]
    for teacher, state in zip(teachers, env.simulation.states(), strict=True):
        teacher.reset(state)
    damping = config.env.damping(env.robot)
    recorder, agreed = StartRecorder(config.states), torch.zeros(env.count)
    for _ in range(_MOST_STEPS * config.states // env.count + 1):
        action = _actions(env, teachers, damping)
        sample = torch.rand(env.count, generator=generator) < _RECORDED
        rows = (sample & (agreed >= _AGREED)).nonzero().squeeze(1)
        if rows.numel():
            recorder.add(env.recorded(rows))
        report(recorder.count / config.states)
        if recorder.full:
            return recorder
        # Noise pushes the robots off the controller's path; recorded states show the way back.
        noise = config.exploration * torch.randn(action.shape, generator=generator)
        done = env.step(action + noise).done
        stepping = torch.tensor([teacher.stepping for teacher in teachers])
        agree = (stepping == (env.gait != int(Gait.STANDING))) & ~held_foot_down(env.readings, env.gait)
        agreed = torch.where(agree & ~done, agreed + env.dt, 0.0)
        states = env.simulation.states()
        for robot in done.nonzero().squeeze(1).tolist():
            teachers[robot].reset(states[robot])
    raise ConfigError(
        f"only {recorder.count} of {config.states} states were recorded: the robots keep falling. Use less "
        "exploration, fewer pushes or other gaits"
    )


def _actions(env: HumanoidEnv, teachers: list[Teacher], damping: np.ndarray) -> torch.Tensor:
    """Return the controllers' actions, shape (n, joints); robots take the phase of stepping controllers."""
    arms, active = env.intervention.source.targets().double().numpy(), env.intervention.active.numpy()
    base = env.next_feed_forward().double().numpy()
    targets = np.zeros((env.count, len(env.robot.joint_names)))
    for i, state in enumerate(env.simulation.states()):
        command, _ = Command.from_array(env.command[i].double().numpy(), Gait(int(env.gait[i]))).clamp(env.robot)
        upper_body = UpperBody.targets(arms[i]) if active[i] else UpperBody.none()
        joints = teachers[i].act(state, command, upper_body)
        targets[i] = equivalent_targets(joints, env.robot, damping) - env.robot.nominal - base[i]
        if teachers[i].stepping:  # otherwise the phase runs on as it does without a controller
            env.phase[i] = teachers[i].phase
    actions = torch.from_numpy(targets / env.config.action_scales(env.robot)).float()
    return torch.nan_to_num(actions).clamp(-ACTION_LIMIT, ACTION_LIMIT)
