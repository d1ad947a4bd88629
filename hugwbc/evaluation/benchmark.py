"""Speed of the parts, each on one thread: training environment, controllers, hand IK."""

import dataclasses
import time
from collections.abc import Callable

import numpy as np
import torch
from mujoco.batch import Batch

from hugwbc.commands import Command
from hugwbc.controller import Controller, UpperBody
from hugwbc.evaluation.loop import Constant
from hugwbc.evaluation.metrics import percentiles
from hugwbc.evaluation.rollout import rollout
from hugwbc.gait import Gait
from hugwbc.learned.config import EnvConfig
from hugwbc.learned.env import HumanoidEnv
from hugwbc.learned.observations import JOINTS
from hugwbc.script_file import load_script
from hugwbc.sim import Simulation
from hugwbc.state import RobotState
from hugwbc.upper_ik import UpperBodySource

WARM_UP_STEPS = 20
WALK = Command(v_x=0.5, gait=Gait.WALKING)


@dataclasses.dataclass(frozen=True)
class EnvironmentSpeed:
    """Speed of the training environment, in control steps of one robot per second.

    Attributes:
        steps_per_s: observations, rewards and resets included, the learner not.
        bare_steps_per_s: `mujoco.batch` alone: same model, batch size, substeps and states.
        ratio: of the two.
        count: robots in the batch.
        control_steps: measured.
    """

    steps_per_s: float
    bare_steps_per_s: float
    ratio: float
    count: int
    control_steps: int


def environment_speed(count: int, control_steps: int, seed: int = 0) -> EnvironmentSpeed:
    """Measure the training environment against bare physics, on one thread.

    Before every step the bare batch gets the environment's states and controls: both simulate the same contacts.
    Actions are noise: robots stumble, fall and are reset, as early in training.

    Args:
        count: robots in the batch.
        control_steps: to measure, after a warm-up.
        seed: of environment and actions.
    """
    config = EnvConfig(count=count)
    torch.set_num_threads(1)
    env = HumanoidEnv(config, seed=seed, threads=1)
    bare = Batch(env.simulation.model, count, 1)
    states = {name: bare.bind(name) for name in ("qpos", "qvel", "ctrl")}
    generator = torch.Generator().manual_seed(seed)
    env_s = bare_s = 0.0
    for step in range(WARM_UP_STEPS + control_steps):
        action = 0.5 * torch.randn(count, JOINTS, generator=generator)
        for name in ("qpos", "qvel"):
            states[name][:] = getattr(env.simulation, name)
        begin = time.perf_counter()
        env.step(action)
        env.observe()
        middle = time.perf_counter()
        states["ctrl"][:] = env.simulation.ctrl
        start = time.perf_counter()
        bare.step(nstep=config.substeps)
        if step >= WARM_UP_STEPS:
            env_s += middle - begin
            bare_s += time.perf_counter() - start
    total = count * control_steps
    return EnvironmentSpeed(total / env_s, total / bare_s, bare_s / env_s, count, control_steps)


def controller_tick(controller: Controller, duration: float) -> dict[str, float]:
    """Median and 99th percentile of a controller's call while it walks at 0.5 m/s [ms]."""
    torch.set_num_threads(1)
    trace = rollout(controller, Constant(WALK), Simulation(), duration=duration)
    return percentiles(trace.tick_ms)


def policy_tick(controller: Controller, calls: int) -> dict[str, float]:
    """Median and 99th percentile of a policy's call at a standing state [ms]: its work does not depend on the state."""
    torch.set_num_threads(1)
    state = Simulation().state()
    controller.reset(state)
    return percentiles(_times(lambda _: controller.act(state, WALK, UpperBody.none()), calls))


def ik_tick(calls: int) -> dict[str, float]:
    """Median and 99th percentile of one call of the hand IK, gravity compensation included, on moving targets [ms]."""
    script, dt = load_script("loco_manipulation"), 0.02
    source = UpperBodySource(gravity_compensation=True)
    state: RobotState = Simulation().state()
    return percentiles(_times(lambda i: source.update(state, script.hands_at(2.0 + i * dt % 10.0), dt), calls))


def _times(call: Callable[[int], object], count: int) -> np.ndarray:
    """Time of each call after a warm-up [ms], shape (count,)."""
    times = []
    for index in range(WARM_UP_STEPS + count):
        begin = time.perf_counter()
        call(index)
        times.append(1e3 * (time.perf_counter() - begin))
    return np.array(times[WARM_UP_STEPS:])
