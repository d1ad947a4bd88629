import numpy as np
import pytest
import torch

from hugwbc import Command, Gait, load_robot
from hugwbc.evaluation.moved_arms import ArmIntervention
from hugwbc.learned.env.arm_intervention import MotionTargets, NoiseTargets
from hugwbc.runtime import Constant, rollout
from hugwbc.runtime.controllers import HoldController
from hugwbc.scripts.motion import ArmMotion
from hugwbc.sim import Simulation

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
