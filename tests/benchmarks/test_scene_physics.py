"""What docs/scenes.md says of grasps: the contacts of a scene hold a box, and the measuring tells them from others."""

from hugwbc.benchmarks.scene_physics import grasp, nine_boxes
from hugwbc.sim import Simulation


def test_two_hands_hold_a_box_and_do_not_enter_it() -> None:
    held = grasp(1.0, 40.0)
    assert held.unrest < 1.0 and held.slip < 2e-3 and 0.0 < held.depth < 5e-3


def test_too_few_iterations_of_the_solver_lose_it() -> None:
    assert grasp(1.0, 40.0, iterations=8, time_constant=0.005, impedance=(0.99, 0.995)).unrest > 5.0


def test_objects_at_rest_sleep() -> None:
    simulation = Simulation(scene=nine_boxes())
    assert simulation.data.nefc > 200
    for _ in range(100):
        simulation.step(simulation._command, 0.002)
    assert simulation.data.nefc < 100 and simulation.data.ntree_awake == 1
