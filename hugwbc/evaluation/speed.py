"""Measure the speed of training and its environment, of controllers, of an episode and of the hand IK."""

import dataclasses
import time
from collections.abc import Callable

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch

from hugwbc.commands import Command
from hugwbc.controller import Controller, JointCommand, UpperBody
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.metrics import percentiles
from hugwbc.gait import Gait
from hugwbc.learned.config import EnvConfig, TrainConfig
from hugwbc.learned.config.training_settings import Device
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.learned.rl.trainer import Trainer
from hugwbc.mbc import WholeBodyController
from hugwbc.runtime.rollout import rollout
from hugwbc.scripts.script import load_script
from hugwbc.sim import Simulation
from hugwbc.sim.batch import BatchSimulation
from hugwbc.tasks import load_task, run_task
from hugwbc.upper_ik import UpperBodySource

WARM_UP_STEPS = 20
WALK = Command(v_x=0.5, gait=Gait.WALKING)
COMMANDS = {"standing": Command(), "walking": WALK, "jumping": Command(v_x=0.5, gait=Gait.JUMPING)}
"""Commands under which controllers are measured; in jumping, `qp` plans forces as well."""
ACTIVITIES = (*COMMANDS, "fetch_box")
"""What the robot does in the episodes that are measured: commands, and a task."""


@dataclasses.dataclass(frozen=True)
class TrainingSpeed:
    """Speed of training and of its parts, in control steps of one robot per second."""

    device: str  # where everything is computed
    count: int  # number of robots
    bare: float  # speed of the engine alone, with the same model, states and substeps
    environment: float  # speed with observations, rewards and resets, without the learner
    learner: float  # speed of the learner alone
    training: float  # speed of all together


def training_speed(count: int, control_steps: int, iterations: int, threads: int, device: Device) -> TrainingSpeed:
    """Measure bare physics, the training environment, and whole training iterations; nothing is saved.

    Before every step bare physics gets the environment's states and controls, so that both simulate the same contacts.
    The actions are noise: robots stumble, fall and are reset, as at the start of a training. Of bare physics and the
    environment `control_steps` are measured after a warm-up, of training the iterations after the first.
    """
    config = TrainConfig(env=EnvConfig(count=count), threads=threads, evaluation_steps=0, device=device)
    trainer = Trainer(config)
    env = trainer.env
    bare, advance = _bare_physics(env, threads)
    env_s = bare_s = 0.0
    for step in range(WARM_UP_STEPS + control_steps):
        action = 0.5 * torch.randn(env.actions[0].shape, generator=trainer.generator, device=env.device)
        for name in ("qpos", "qvel"):
            bare[name][:] = getattr(env.simulation, name)
        begin = _now(env)
        env.step(action)
        env.observe()
        middle = _now(env)
        bare["ctrl"][:] = env.simulation.ctrl
        start = _now(env)
        advance()
        if step >= WARM_UP_STEPS:
            env_s += middle - begin
            bare_s += _now(env) - start
    trainer.iterate()
    begin, rows = _now(env), [trainer.iterate() for _ in range(iterations)]
    seconds = _now(env) - begin
    learning = sum((1.0 - row["collect_fraction"]) / row["steps_per_second"] for row in rows) / iterations
    steps, samples = count * control_steps, count * config.ppo.horizon * iterations
    place = torch.cuda.get_device_name(env.device) if env.device.type == "cuda" else trainer.device
    return TrainingSpeed(place, count, steps / bare_s, steps / env_s, 1.0 / learning, samples / seconds)


def _bare_physics(env: HumanoidEnv, threads: int) -> tuple[dict[str, torch.Tensor], Callable[[], object]]:
    """Return the states of robots in the environment's engine alone, and what advances them by a control step."""
    ours, substeps = env.simulation, env.config.substeps
    if isinstance(ours, BatchSimulation):
        batch = Batch(ours.model, ours.count, threads)
        states = {name: torch.from_numpy(batch.bind(name)) for name in ("qpos", "qvel", "ctrl")}
        return states, lambda: batch.step(nstep=substeps)
    from hugwbc.sim.warp_batch import WarpBatch

    twin = WarpBatch(ours.count, device=str(ours.device))
    return {"qpos": twin.qpos, "qvel": twin.qvel, "ctrl": twin.ctrl}, lambda: twin.step(substeps)


def _now(env: HumanoidEnv) -> float:
    """Return the time at which the environment's device has done its work [s]."""
    if env.device.type == "cuda":
        torch.cuda.synchronize(env.device)
    return time.perf_counter()


@dataclasses.dataclass(frozen=True)
class QpSpeed:
    """Speed and reliability of `qp` in one gait."""

    tick_ms: dict[str, float | None]  # p50 and p99 of the time for a call, from state to joint command [ms]
    cpu_ms: dict[str, float | None]  # the same in processor time, which other processes do not lengthen [ms]
    unsolved: float  # share of the calls whose QP was not solved, or only without its joint limits
    ticks: int  # number of calls that were measured


def qp_speed(command: Command, duration: float) -> QpSpeed:
    """Time every call of `qp` under one command for some simulated time [s], from a stand."""
    simulation = Simulation()
    controller = WholeBodyController(simulation.robot)
    state, arms = simulation.reset(), UpperBody.none()
    controller.reset(state)
    joint_command = JointCommand.position(simulation.robot, state.q)
    wall, cpu = [], []
    for _ in range(max(1, round(duration / controller.period))):
        begin = time.perf_counter(), time.thread_time()
        answer = controller.act(state, command, arms)
        end = time.perf_counter(), time.thread_time()
        wall.append(1e3 * (end[0] - begin[0]))
        cpu.append(1e3 * (end[1] - begin[1]))
        joint_command = answer or joint_command
        state = simulation.step(joint_command, controller.period)
    counts = controller.diagnostics
    unsolved = (counts.fallbacks + counts.relaxed) / len(wall)
    return QpSpeed(percentiles(np.array(wall)), percentiles(np.array(cpu)), unsolved, len(wall))


@dataclasses.dataclass(frozen=True)
class EpisodeSpeed:
    """Speed of an episode with everything in the loop: physics, sensors, estimator, controller, filter and record."""

    factor: float  # simulated time for each second of processor time
    # processor time of the episode divided by that of bare MuJoCo steps of a standing robot, measured in the same run
    physics: float
    period_ms: dict[str, float]  # p50 and p99.9 of the time for a control period [ms]
    share: float  # p99.9 of that time as a share of the control period


def episode_speed(controller: Controller, activity: str, duration: float) -> EpisodeSpeed:
    """Measure an episode of a simulated duration [s], and bare physics after it.

    The activity is a key of `COMMANDS`, or the name of a task.
    """
    conditions, wall, cpu = Conditions(), [], []

    def over() -> bool:
        wall.append(time.perf_counter())
        cpu.append(time.process_time())
        return len(wall) > 2 and len(wall) * controller.period > duration

    if activity in COMMANDS:
        source, simulation = COMMANDS[activity], conditions.simulation(duration, (0,))
        longest = duration + 2.0 * controller.period
        rollout(controller, source, simulation, duration=longest, estimator=conditions.estimator(), until=over)
    else:
        task = load_task(activity)
        simulation = conditions.simulation(duration, (0,), task.scene)
        assert isinstance(simulation, Simulation)
        run_task(task, controller, simulation, conditions.estimator(), stop=over)
    standing = Simulation()
    standing.step(JointCommand.position(standing.robot, standing.robot.nominal), standing.timestep)  # sets the gains
    begin, simulated = time.process_time(), (len(cpu) - 1) * controller.period
    mujoco.mj_step(standing.model, standing.data, max(1, round(simulated / standing.timestep)))
    bare, spent = time.process_time() - begin, cpu[-1] - cpu[0]
    p50, p999 = np.percentile(1e3 * np.diff(wall), (50.0, 99.9)).tolist()
    return EpisodeSpeed(simulated / spent, spent / bare, {"p50": p50, "p99.9": p999}, 1e-3 * p999 / controller.period)


def policy_tick(controller: Controller, calls: int) -> dict[str, float | None]:
    """Return median and 99th percentile of a policy's call at a standing state [ms].

    One state is enough, as the work of a network does not depend on its input.
    """
    torch.set_num_threads(1)
    state = Simulation().state()
    controller.reset(state)
    return percentiles(_times(lambda _: controller.act(state, WALK, UpperBody.none()), calls))


def ik_tick(calls: int) -> dict[str, float | None]:
    """Return median and 99th percentile of a call of the hand IK on moving targets [ms]."""
    script, dt = load_script("loco_manipulation"), 0.02
    simulation = Simulation()
    source, state = UpperBodySource(simulation.robot), simulation.state()
    targets = [script.hands_at(2.0 + i * dt % 10.0) for i in range(WARM_UP_STEPS + calls)]
    return percentiles(_times(lambda i: source.update(state, targets[i], Command(), dt), calls))


def _times(call: Callable[[int], object], count: int) -> np.ndarray:
    """Return the time of each call after a warm-up [ms], shape (count,)."""
    times = []
    for index in range(WARM_UP_STEPS + count):
        begin = time.perf_counter()
        call(index)
        times.append(1e3 * (time.perf_counter() - begin))
    return np.array(times[WARM_UP_STEPS:])
