import numpy as np

from hugwbc import Command, Gait, load_robot
from hugwbc.evaluation.engine.batch_record import BatchRecord
from hugwbc.kinematics import Kinematics
from hugwbc.sim import Simulation, Variation
from hugwbc.sim.lockstep import LockstepSimulation


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
