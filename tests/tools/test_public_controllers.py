"""Adapters of public policies, with a network that tells what it reads."""

import numpy as np
import pytest

from hugwbc import Command, Gait, RobotState, UpperBody, load_robot
from hugwbc.errors import ConfigError
from hugwbc.runtime import Simulation

ROBOT = load_robot("g1")


@pytest.fixture(scope="module")
def tool(load_tool):
    return load_tool("public_controllers")


@pytest.fixture
def state() -> RobotState:
    return Simulation(robot="g1", sensing="exact").state()


class Fixed:
    """A network that always gives the same action, and keeps what it reads."""

    def __init__(self, action: np.ndarray) -> None:
        self.action, self.seen = action, []

    def reset(self) -> None:
        pass

    def __call__(self, inputs: list[np.ndarray]) -> np.ndarray:
        self.seen.append(inputs[0].copy())
        return self.action


def built(tool, monkeypatch, name: str, action: float) -> tuple:
    """Return a controller with a fixed network, and the list of what it reads from now on."""
    network = Fixed(np.full({"Homie": 12, "Falcon": 29}[name], action))
    monkeypatch.setattr(tool, "load_network", lambda path, state: network)
    controller = getattr(tool, name)("network.onnx")
    network.seen.clear()  # of the trial that the network fits
    return controller, network.seen


# Sizes of the published networks' inputs and outputs.
@pytest.mark.parametrize(("name", "inputs", "actions"), [("Homie", 456, 12), ("Falcon", 575, 29)])
def test_it_reads_what_the_published_network_takes(tool, monkeypatch, state, name, inputs, actions) -> None:
    controller, seen = built(tool, monkeypatch, name, 0.5)
    controller.reset(state)
    none = UpperBody.none(len(ROBOT.arms))
    for _ in range(2):
        command = controller.act(state, Command(h=-0.1), none)
    assert len(controller.contract.joints) == actions and [len(one) for one in seen] == [inputs, inputs]
    frame = inputs // controller.contract.history.frames
    assert not seen[0][:-frame].any(), "frames before the start are zeros"
    np.testing.assert_array_equal(seen[1][-2 * frame : -frame], seen[0][-frame:])
    knee = ROBOT.index("left_knee_joint")
    assert command.q[knee] == pytest.approx(0.3 + 0.25 * 0.5) and command.is_finite
    assert any(np.isclose(seen[0][-frame:], {"Homie": 0.64, "Falcon": 2 * 0.65}[name])), "the height over the ground"


def test_falcon_walks_at_one_height(tool, monkeypatch, state) -> None:
    controller, seen = built(tool, monkeypatch, "Falcon", 0.0)
    controller.reset(state)
    controller.act(state, Command(h=-0.1, w=0.3, v_x=0.2, gait=Gait.WALKING), UpperBody.none(len(ROBOT.arms)))
    np.testing.assert_allclose(seen[0][-115:][32:40], [0.0, 2 * 0.75, 0.2, 0.0, 1.0, 0.0, 0.0, 0.0], atol=1e-6)


def test_arms_and_waist_go_where_they_are_told(tool, monkeypatch, state) -> None:
    q = np.linspace(-0.2, 0.2, len(ROBOT.arms))
    for name, action, moved in (("Homie", 0.0, 0.0), ("Falcon", 0.4, 0.1)):
        controller, seen = built(tool, monkeypatch, name, action)
        controller.reset(state)
        command = controller.act(state, Command(w=0.3), UpperBody.targets(q))
        np.testing.assert_allclose(command.q[ROBOT.arms], q + moved, err_msg=name)
        if name == "Homie":
            assert command.q[ROBOT.waist] == 0.3
        else:
            np.testing.assert_allclose(seen[0][-len(q) :], q)
            assert 0.3 in np.float64(seen[0][-115:]).round(6) and command.q[ROBOT.waist] == pytest.approx(0.1)


def test_without_a_network_it_says_where_one_is(tool) -> None:
    with pytest.raises(ConfigError, match="homie has no network; give the ONNX file with --policy"):
        tool.Homie()
