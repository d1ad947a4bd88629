import numpy as np
import pytest
import torch

from hugwbc.learned.config import EnvConfig, RandomizationConfig
from hugwbc.learned.env.action_latency import Latency, draw_delays
from hugwbc.learned.env.humanoid_env import HumanoidEnv
from hugwbc.robot import load_robot
from hugwbc.sim.batch import BatchSimulation

NOMINAL = load_robot().nominal


class Recorder:
    """Stands in for a simulation: notes the target that acts in every physics step."""

    def __init__(self, count: int) -> None:
        self.ctrl = np.zeros((count, 1))
        self.acted: list[list[float]] = []

    def step(self, substeps: int) -> np.ndarray:
        self.acted.append(self.ctrl[:, 0].tolist())
        return np.zeros(len(self.ctrl), dtype=bool)


def test_targets_act_as_many_physics_steps_later_as_each_robot_s_delay() -> None:
    delays = np.array([0, 1, 4, 6])
    simulation, latency = Recorder(4), Latency(delays, substeps=4, joints=1)
    latency.reset(np.arange(4), np.full((4, 1), -1.0))
    for target in range(4):
        simulation.ctrl[:] = target
        latency.step(simulation)  # type: ignore[arg-type]
        assert (simulation.ctrl == target).all()
    given = np.repeat(np.arange(4.0), 4)
    for robot, delay in enumerate(delays):
        expected = np.concatenate((np.full(delay, -1.0), given))[:16]
        assert [row[robot] for row in simulation.acted] == expected.tolist()


def test_delays_are_drawn_in_physics_steps() -> None:
    assert draw_delays(5, (0.0, 0.0), 0.005, np.random.default_rng(0)) is None
    delays = draw_delays(2000, (0.005, 0.02), 0.005, np.random.default_rng(0))
    assert delays is not None and set(delays.tolist()) == {1, 2, 3, 4}


def make(latency: float) -> HumanoidEnv:
    torch.set_num_threads(1)
    randomization = RandomizationConfig(latency=(latency, latency), push_velocity=0.0)
    env = HumanoidEnv(EnvConfig(count=4, randomization=randomization, waist_rate=0.0), seed=1, threads=1)
    env.age[:] = 10
    return env


def test_a_latency_of_a_control_step_shifts_the_motion_by_one() -> None:
    late, prompt = make(0.02), make(0.0)
    generator = torch.Generator().manual_seed(0)
    actions = [0.3 * torch.randn(4, 19, generator=generator) for _ in range(6)]
    scales = prompt.config.action_scales(load_robot())
    # What acts before the first late target: the joint positions of the start.
    hold = torch.tensor((prompt.simulation.qpos[:, 7:] - NOMINAL) / scales, dtype=torch.float32)
    for action in actions:
        late.step(action)
    for action in [hold, *actions[:-1]]:
        prompt.step(action)
    np.testing.assert_allclose(late.simulation.qpos, prompt.simulation.qpos, atol=1e-4)
    other = make(0.0)
    for action in actions:
        other.step(action)
    assert np.abs(other.simulation.qpos - prompt.simulation.qpos).max() > 0.01


def test_steps_one_by_one_are_a_control_step() -> None:
    split, whole = BatchSimulation(3), BatchSimulation(3)
    latency = Latency(np.zeros(3, dtype=int), substeps=4, joints=19)
    for step in range(10):
        for simulation in (split, whole):
            simulation.ctrl[:] = NOMINAL + 0.1 * np.sin(step + np.arange(19))
        latency.step(split)
        whole.step(4)
    np.testing.assert_array_equal(split.qpos, whole.qpos)


def test_restored_run_with_latency_continues_bit_for_bit() -> None:
    straight, resumed, prompt = make(0.03), make(0.03), make(0.0)
    for _ in range(5):
        straight.step(0.2 * torch.ones(4, 19))
    resumed.load_state_dict({name: value.clone() for name, value in straight.state_dict().items()})
    for env in (straight, resumed):
        env.step(torch.zeros(4, 19))
    np.testing.assert_array_equal(straight.simulation.qpos, resumed.simulation.qpos)
    # The state of a run without latency: what acted last goes on until the first late target.
    resumed.load_state_dict(prompt.state_dict())
    assert resumed.latency is not None
    torch.testing.assert_close(resumed.latency.targets[1].numpy(), prompt.simulation.ctrl.copy())


@pytest.mark.parametrize("latency", [0.0, 0.02])
def test_a_diverged_robot_is_noticed_in_any_physics_step(latency: float) -> None:
    env = make(latency)
    env.simulation.qvel[2, 8] = np.nan
    result = env.step(torch.zeros(4, 19))
    assert result.done.tolist() == [False, False, True, False]
