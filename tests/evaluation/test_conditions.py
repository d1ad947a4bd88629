import dataclasses
import importlib.util
import math

import numpy as np
import pytest
import torch

from hugwbc import Command, Gait, JointCommand, load_robot
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import ArmIntervention, Conditions
from hugwbc.evaluation.episode import CountedSettings
from hugwbc.learned.env.arm_intervention import MotionTargets, NoiseTargets
from hugwbc.runtime import Constant, rollout
from hugwbc.runtime.controllers import HoldController
from hugwbc.scripts.motion import ArmMotion
from hugwbc.sim import Simulation, Variation


def test_rough_ground_reaches_as_far_as_the_robot_can_walk_and_follows_the_seed():
    rough = Conditions(terrain_roughness=0.02)
    first, same, other = (rough.simulation(10.0, seed).terrain for seed in ((0, 1), (0, 1), (0, 2)))
    assert first is not None and same is not None and other is not None
    np.testing.assert_array_equal(first.heights, same.heights)
    assert not np.array_equal(first.heights, other.heights)
    assert 0.019 < np.abs(first.heights).max() <= 0.02
    assert min(first.size) / 2 > 20.0  # 10 s at 2 m/s
    assert first.height_at(np.array([0.2, -0.2])) == 0.0
    assert Conditions().simulation(10.0, (0,)).terrain is None


def test_a_slope_is_under_the_robot_s_feet_at_once_and_rises_along_its_heading():
    simulation = Conditions(slope=0.087).simulation(2.0, (3,))
    assert simulation.ground_height(np.array([2.0, 1.0])) == pytest.approx(2.0 * math.tan(0.087))
    state = simulation.step(JointCommand.position(simulation.robot, simulation.robot.nominal), 0.1)
    assert state.foot_force is not None and (state.foot_force[:, 2] > 50.0).all()
    with pytest.raises(ConfigError, match="slope is 1"):
        Conditions(slope=1.0)


def test_arms_follow_seed_and_kind(tmp_path):
    assert Conditions().arms((0,)) is None
    state = Conditions().simulation(1.0, (0,)).state()

    def posture(conditions, seed):
        arms = conditions.arms(seed)
        return [arms.update(state, None, Command(), 0.02)[0].q for _ in range(70)][-1]

    noise = Conditions(intervention="noise")
    np.testing.assert_array_equal(posture(noise, (0, 1)), posture(noise, (0, 1)))
    assert not np.array_equal(posture(noise, (0, 1)), posture(noise, (0, 2)))
    ArmMotion("still", 50.0, np.full((200, 8), 0.25), load_robot()).save(tmp_path / "still.npz")
    still = Conditions(intervention="motion", motions=str(tmp_path))
    np.testing.assert_allclose(posture(still, (0, 1)), 0.25, atol=1e-6)  # wherever in the motion it started
    assert not np.array_equal(posture(Conditions(intervention="motion"), (0,)), posture(still, (0,)))


def test_bad_conditions_are_refused():
    with pytest.raises(UnknownNameError, match="Did you mean 'noise'"):
        Conditions(intervention="nois")
    for roughness in (-0.01, 0.6, math.nan):
        with pytest.raises(ConfigError, match="terrain_roughness is"):
            Conditions(terrain_roughness=roughness)


def test_robot_and_sensors_vary_as_told():
    simulation = Conditions(payload=5.0, friction=0.5, gain=0.9, strength=0.8).simulation(1.0, (0,))
    assert simulation.variation == Variation(5.0, 0.5, 0.9, 0.8)
    hold = JointCommand.position(load_robot(), load_robot().nominal)
    for conditions, age in (
        (Conditions(sensing="exact"), 0.0), (Conditions(sensing="exact", latency=0.02), 0.02),
        (Conditions(), 0.01), (Conditions(latency=0.03), 0.03),
    ):  # fmt: skip
        simulation = conditions.simulation(1.0, (0,))
        simulation.step(hold, 0.1)
        assert simulation.sense().age == pytest.approx(age), conditions
    for values in ({"latency": 1.0}, {"latency": math.nan}, {"strength": 0.0}):
        with pytest.raises(ConfigError, match=next(iter(values))):
            Conditions(**values)


def test_what_differs_from_the_defaults_is_said():
    settings = CountedSettings(seed=7, episodes=9)
    assert settings.remark == ""
    conditions = Conditions(robot="g1", drives="ideal", payload=5.0, faults=("imu-gone@2:1", "imu-gone@4:1"))
    remark = dataclasses.replace(settings, gait="jumping", conditions=conditions).remark
    assert remark == "gait jumping, robot g1, drives ideal, payload 5, faults imu-gone@2:1 and imu-gone@4:1"


def test_a_payload_that_is_drawn_is_in_proportion_to_the_robot():
    masses = [Conditions(robot=name).of_a_drawn_robot(np.random.default_rng(0)).payload for name in ("h1", "g1")]
    assert masses[1] / masses[0] == pytest.approx(load_robot("g1").mass / load_robot("h1").mass)


def test_the_controller_may_be_told_another_robot_than_moves():
    right, wrong = Conditions(), Conditions(told="h1-2023")
    assert right.told_arena == right.chosen
    assert wrong.told_arena == dataclasses.replace(wrong.chosen, robot="h1-2023")
    assert wrong.simulation(1.0, (0,)).robot is load_robot("h1")
    assert wrong.upper_body().robot is load_robot("h1-2023")
    with pytest.raises(UnknownNameError, match="robot"):
        Conditions(told="h2")


def test_an_engine_is_refused_where_it_cannot_be_used(monkeypatch):
    with pytest.raises(UnknownNameError, match=r"engine 'bullet'.*mujoco, physx"):
        Conditions(engine="bullet")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "sapien" else object())
    with pytest.raises(ConfigError, match=r"engine physx needs sapien: run `pip install 'hugwbc\[physx\]'`"):
        Conditions(engine="physx")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    for uneven in ({"terrain_roughness": 0.02}, {"slope": 0.1}):
        with pytest.raises(ConfigError, match="engine physx has level ground only"):
            Conditions(engine="physx", **uneven)
    with pytest.raises(ConfigError, match="engine physx has firm ground only"):
        Conditions(engine="physx", ground="soft")


def test_an_evaluation_in_physx_runs_in_physx():
    conditions = Conditions(engine="physx", payload=4.0, robot="h1-2023", ground="firm")
    simulation = conditions.simulation(1.0, (0,))
    assert simulation.engine == "physx" and simulation.robot.name == "h1-2023"
    assert sum(link.mass for link in simulation._links.values()) == pytest.approx(simulation.robot.mass + 4.0)
    state = simulation.step(JointCommand.position(simulation.robot, simulation.robot.nominal), 0.3)
    assert not simulation.fallen and state.foot_force is not None


ARMS = load_robot().arms


def noise(seed: int = 0) -> ArmIntervention:
    return ArmIntervention(NoiseTargets(load_robot(), 1, 90, torch.Generator().manual_seed(seed)), load_robot())


def updates(source: ArmIntervention, dt: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    state = Simulation(sensing="exact").state()
    bodies = [source.update(state, None, Command(), dt)[0] for _ in range(count)]
    assert all(body.mask.all() for body in bodies)
    return np.array([body.q for body in bodies]), np.array([body.dq for body in bodies])


def test_a_fast_controller_gets_the_slow_ones_postures_and_the_way_between():
    slow, _ = updates(noise(), 0.02, 40)
    fast, speed = updates(noise(), 0.002, 400)
    np.testing.assert_allclose(fast[9::10], slow, atol=1e-9)
    nominal = load_robot().nominal[ARMS]
    full = np.concatenate((nominal[None], fast))
    np.testing.assert_allclose(np.diff(full, axis=0), 0.002 * speed, atol=1e-9)


def test_reset_starts_at_nominal_with_other_targets():
    source = noise()
    first, _ = updates(source, 0.02, 80)
    source.reset()
    second, _ = updates(source, 0.02, 80)
    assert np.abs(second[0] - load_robot().nominal[ARMS]).max() < 0.1 < np.abs(second - first).max()
    assert len(source.postures) == 80


def test_the_arm_error_is_the_distance_of_the_joints_to_their_targets():
    """Targets that stand still at 0.3 rad from nominal, away from the body: the joints settle there nearly."""
    nominal = load_robot().nominal[ARMS]
    goal = nominal + 0.3 * np.array([1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
    motion = ArmMotion("still", 50.0, np.tile(goal, (200, 1)), load_robot())
    arms = ArmIntervention(MotionTargets(load_robot(), 1, [motion], torch.Generator().manual_seed(0)), load_robot())
    trace = rollout(
        HoldController(load_robot()),
        Constant(Command(gait=Gait.STANDING)),
        Simulation(sensing="exact"),
        arms,
        duration=1.6,
    )
    final = np.abs(trace.qpos[-1, 7:][ARMS] - goal).mean()
    assert 0.0 < final < 0.15
    assert arms.error(trace, settle=1.2) == pytest.approx(final, abs=0.03)
    # While the targets are faded in over half a second, the joints lag behind.
    assert arms.error(trace, settle=0.0) > arms.error(trace, settle=1.2)
    assert np.isnan(arms.error(trace, settle=5.0))
