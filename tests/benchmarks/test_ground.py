"""The ground is as firm as docs/arena.md says, and the measuring tells firm from soft."""

import dataclasses

import numpy as np
import pytest

from hugwbc.benchmarks import ground
from hugwbc.benchmarks.ground import FORMER_GROUND, Physics, batch_times, energy_drift, grid, run
from hugwbc.commands import Command
from hugwbc.gait import Gait
from hugwbc.sim import Actuators, Ground

STAND = Command(gait=Gait.STANDING)


def test_a_stand_sinks_a_tenth_of_a_millimetre_and_soft_ground_gives_more() -> None:
    firm = run("qp", STAND, Physics(), 0.4, settling=0.2)
    soft = run("qp", STAND, Physics(ground=FORMER_GROUND), 0.4, settling=0.2)
    assert not firm.fell and not soft.fell
    assert 0.0 < firm.sink < 0.2e-3 < 0.5e-3 < soft.sink
    assert firm.slip < 1e-3
    assert 0.5 < firm.peak < 0.8, "each foot bears half of the weight"


@pytest.mark.slow
@pytest.mark.parametrize(("name", "deepest"), [("qp", 5e-3), ("learned", 8e-3)])
def test_landings_of_a_walk_with_real_drives_sink_a_few_millimetres(name: str, deepest: float) -> None:
    for speed in ground.SPEEDS:
        walk = run(name, Command(v_x=speed, gait=Gait.WALKING), Physics(actuators=Actuators()), ground.WALK_TIME)
        assert not walk.fell
        assert walk.sink < deepest
        assert walk.speed == pytest.approx(speed, abs=0.1)


def test_the_integrator_keeps_the_energy_of_a_flight_and_a_shorter_step_keeps_it_better() -> None:
    drifts = [abs(energy_drift(Physics(timestep))) for timestep in (0.001, 0.002, 0.005)]
    assert drifts == sorted(drifts)
    assert drifts[1] < 0.01


def test_every_physics_of_the_grid_has_a_time_constant_that_its_time_step_allows() -> None:
    physics = [physics for _, physics in grid()]
    assert len(physics) == len(set(map(dataclasses.astuple, physics)))
    assert all(one.ground.time_constant >= 2.0 * one.timestep for one in physics)
    assert Ground() in [one.ground for one in physics], "the chosen one"


def test_the_batch_times_begin_with_the_former_physics() -> None:
    times = batch_times(4, control_steps=2, threads=1, repeats=1)
    assert next(iter(times)).startswith("former")
    assert len(times) == 6 and np.all(np.array(list(times.values())) > 0.0)
