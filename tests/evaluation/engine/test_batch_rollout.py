import dataclasses

import numpy as np
import pytest

from hugwbc import Command, Gait, load_robot
from hugwbc.errors import ConfigError, UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import Knot, Schedule, Tour, Waypoint
from hugwbc.evaluation.engine.batch_rollout import BatchMember, BatchRecord, batch_rollout, fits, most_robots
from hugwbc.evaluation.engine.plans import Navigator
from hugwbc.kinematics import Kinematics
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.runtime.rollout import rollout
from hugwbc.runtime.trace import Trace
from hugwbc.scripts import Constant
from hugwbc.sim import Force, Simulation, Variation
from hugwbc.sim.lockstep import LockstepSimulation

COARSE = Conditions(timestep=0.005, sensing="exact")
WALK, STAND = Command(v_x=0.6, gait=Gait.WALKING), Command(h=-0.1, w=0.4, gait=Gait.STANDING)
TURN = Schedule((Knot(0.0, WALK), Knot(0.3, Command(v_x=0.3, omega=2.0, gait=Gait.WALKING), ramp=0.4)))
SHOVE = Force((0.0, 400.0, 0.0), start=0.3, duration=0.3, frame="heading")
OTHER = dataclasses.replace(COARSE, payload=3.0, friction=0.6, gain=1.05, strength=0.95)
MOVED = dataclasses.replace(COARSE, intervention="noise")
PLANS = [
    (Constant(WALK), COARSE, ()),
    (Constant(STAND), MOVED, ()),
    (TURN, OTHER, ()),
    (Constant(WALK), COARSE, (SHOVE, Force((0.0, 0.0, -30.0), link="pelvis"))),
    (Constant(dataclasses.replace(WALK, gait=Gait.JUMPING)), MOVED, ()),
    (Navigator(Tour((Waypoint(1.0, 0.5, 0.4), Waypoint(0.0, 0.0, 0.0)), 0.5, Gait.WALKING)), COARSE, ()),
]


@pytest.fixture(scope="module")
def policy():
    """The shipped policy."""
    return ControllerSpec("learned").build()


def _arms(conditions: Conditions, index: int):
    return conditions.arms((0, index))


def _batch(policy, duration: float, **changes) -> list[Trace | None]:
    episodes = [BatchMember(s, dataclasses.replace(c, **changes), f, _arms(c, i)) for i, (s, c, f) in enumerate(PLANS)]
    return batch_rollout(policy, episodes, duration=duration)


def _alone(policy, index: int, duration: float, **changes) -> Trace:
    source, conditions, forces = PLANS[index]
    conditions = dataclasses.replace(conditions, **changes)
    simulation = conditions.simulation(duration, (0, index))
    return rollout(policy, source, simulation, _arms(conditions, index), duration=duration, forces=forces)


def _assert_same(one: Trace, other: Trace, tolerance: float) -> None:
    timing = {"tick_ms", "ik_ms", "pressure_centre", "safety"}
    for field in dataclasses.fields(Trace):
        if field.name not in timing:
            expected, found = getattr(one, field.name), getattr(other, field.name)
            if isinstance(expected, np.ndarray):
                np.testing.assert_allclose(found, expected, atol=tolerance, rtol=0, err_msg=field.name)
            elif isinstance(expected, tuple):  # of the left and the right foot
                for mine, alone in zip(found, expected, strict=True):
                    np.testing.assert_array_equal(mine, alone, err_msg=field.name)
            else:
                assert expected == found, field.name
    assert dataclasses.replace(one.safety, overruns=0) == dataclasses.replace(other.safety, overruns=0)


def test_the_first_second_is_that_of_single_rollouts(policy):
    batch = _batch(policy, 1.0)
    for index, trace in enumerate(batch):
        assert trace is not None and trace.tick_ms.size == trace.steps
        _assert_same(_alone(policy, index, 1.0), trace, 1e-6)


def test_a_fall_ends_one_robot_alone(policy):
    falls = [trace.fell for trace in _batch(policy, 1.6)]
    assert falls == [False, False, False, True, False, False]
    _assert_same(_alone(policy, 3, 1.6), _batch(policy, 1.6)[3], 1e-6)


def test_the_finer_time_step_of_evaluations(policy):
    source, conditions, forces = PLANS[0]
    conditions = dataclasses.replace(conditions, timestep=0.002)
    (trace,) = batch_rollout(policy, [BatchMember(source, conditions, forces)], duration=0.4)
    _assert_same(_alone(policy, 0, 0.4, timestep=0.002), trace, 1e-6)


@pytest.mark.parametrize("spoiled_rows", [[0], list(range(len(PLANS)))])
def test_what_the_policy_cannot_answer_is_left_to_a_rollout_by_itself(policy, monkeypatch, spoiled_rows):
    make = policy.for_many

    def spoiled(count):
        rows = make(count)
        decide = rows.decide

        def first_fails(*inputs):
            targets = decide(*inputs)
            if len(targets) == len(PLANS):
                targets[spoiled_rows, 3] = np.nan
            return targets

        rows.decide = first_fails
        return rows

    monkeypatch.setattr(policy, "for_many", spoiled)
    batch = _batch(policy, 0.2)
    assert [index for index, trace in enumerate(batch) if trace is None] == spoiled_rows
    monkeypatch.undo()
    if batch[2] is not None:
        _assert_same(_alone(policy, 2, 0.2), batch[2], 1e-6)


def test_what_a_batch_cannot_express_does_not_fit(policy):
    assert fits(policy, OTHER) and fits(policy, MOVED) and not fits(ControllerSpec("hold").build(), COARSE)
    for change in ({"terrain_roughness": 0.01}, {"slope": 0.05}, {"sensing": "robot"}, {"latency": 0.01}):
        assert not fits(policy, dataclasses.replace(COARSE, **change))
    assert most_robots(1.0) == 2048 > most_robots(60.0) > 50


def test_errors_are_those_of_a_rollout(policy):
    with pytest.raises(ConfigError, match="choose a time step that divides it"):
        batch_rollout(policy, [BatchMember(Constant(WALK), Conditions(timestep=0.003))], duration=0.1)
    with pytest.raises(UnknownNameError, match="unknown link 'torso'"):
        batch_rollout(
            policy, [BatchMember(Constant(WALK), COARSE, (Force((1.0, 0.0, 0.0), link="torso"),))], duration=0.1
        )


def test_samples_are_what_kinematics_measures_and_end_with_each_robot():
    robot, walk = load_robot(), Command(v_x=0.5, gait=Gait.WALKING)
    gains = np.tile(robot.kp, (2, 1)), np.tile(robot.kd, (2, 1))
    simulation = LockstepSimulation([Variation(), Variation(payload=5.0)], *gains, timestep=0.005)
    record, rows = BatchRecord(2, 1.0), np.arange(2)
    simulation.qvel[:, :6] = [0.3, -0.2, 0.0, 0.1, 0.2, 0.5]
    for tick in range(20):
        t = 0.02 * tick
        rows = rows if tick < 12 else rows[:1]
        assert record.due(t) and not record.due(t - 0.01)
        target = np.tile(robot.nominal, (rows.size, 1))
        record.sample(t, simulation, rows, [walk] * rows.size, phase=np.full(rows.size, 0.25), target=target)
        simulation.command(rows, target, np.zeros_like(target))
        for _ in range(4):
            simulation.step(rows)
    samples, other = record.of(0), record.of(1)
    assert (samples["time"].size, other["time"].size) == (20, 12) and np.isnan(samples["foothold"]).all()
    assert samples["time"][-1] == 0.38 and set(samples["phase"]) == {0.25}
    alone, kinematics = Simulation(timestep=0.005), Kinematics()
    for index in (3, 19):
        alone.data.qpos[:], alone.data.qvel[:] = samples["qpos"][index], samples["qvel"][index]
        kinematics.update(alone.state())
        measured = kinematics.measured()
        expected = [getattr(measured, name) for name in ("v_x", "v_y", "omega", "h", "p", "w")]
        np.testing.assert_allclose(samples["measured"][index], expected, atol=1e-12)
        np.testing.assert_allclose(samples["clearance"][index], measured.clearance, atol=1e-12)
