import numpy as np

from hugwbc import Command, Gait, UpperBody, load_robot
from hugwbc.mbc import WholeBodyController
from hugwbc.mbc.proxsuite_build import proxqp
from hugwbc.sim import Simulation


def test_the_build_is_the_one_for_any_processor():
    assert "avx" not in proxqp.__name__


def test_controllers_whose_memory_lies_elsewhere_give_the_same_torques():
    between, controllers = [], []
    for index in range(4):
        between.append(bytearray(17 * index + 1))
        controllers.append(WholeBodyController(load_robot()))
    simulation = Simulation()
    state, command = simulation.state(), Command(v_x=0.5, gait=Gait.WALKING)
    for controller in controllers:
        controller.reset(state)
    for _ in range(60):
        outputs = [controller.act(state, command, UpperBody.none()) for controller in controllers]
        for output in outputs[1:]:
            np.testing.assert_array_equal(output.tau, outputs[0].tau)
            np.testing.assert_array_equal(output.dq, outputs[0].dq)
        state = simulation.step(outputs[0], controllers[0].period)
