"""The motion modes are released before anything is sent."""

import json

import pytest
from local_endpoint import local_pair

from hugwbc.deploy import transport
from hugwbc.deploy.transport import SimulatedSwitcher, release_modes
from hugwbc.errors import DeploymentError


def test_an_active_mode_is_released() -> None:
    robot, client = local_pair()
    switcher = SimulatedSwitcher("normal")
    robot.serve(switcher)
    assert release_modes(client, required=True) == "released normal"
    assert not switcher.active
    assert release_modes(client, required=True) == "no motion mode is active"


def test_a_robot_without_a_switcher_is_an_error_only_where_it_is_required() -> None:
    _, client = local_pair()
    with pytest.raises(DeploymentError, match="does not answer"):
        release_modes(client, required=True)
    assert release_modes(client, required=False) == "the motion switcher does not answer"


def test_an_error_of_the_switcher_does_not_mean_that_no_mode_is_active() -> None:
    robot, client = local_pair()
    robot.serve(lambda number, parameter: (3204, ""))
    with pytest.raises(DeploymentError, match="error 3204"):
        release_modes(client, required=True)
    assert release_modes(client, required=False) == "the motion switcher answers with error 3204"


def test_a_mode_that_needs_a_second_release_is_named_once() -> None:
    robot, client = local_pair()
    names = iter(["ai\n", "", "ai\n", "", ""])  # a check and a release in turn
    robot.serve(lambda number, parameter: (0, json.dumps({"name": next(names)})))
    assert release_modes(client, required=True) == r"released ai\n"


def test_a_mode_that_stays_is_an_error(monkeypatch) -> None:
    monkeypatch.setattr(transport, "_PAUSE", 0.0)
    robot, client = local_pair()
    robot.serve(lambda number, parameter: (0, json.dumps({"name": "ai"})))
    with pytest.raises(DeploymentError, match="motion mode 'ai' stays active"):
        release_modes(client, required=True)


@pytest.mark.parametrize("data", ['{"form": "0", "name": ""}', '{"name": null}'])
def test_an_empty_name_means_that_no_mode_is_active(data) -> None:
    robot, client = local_pair()
    robot.serve(lambda number, parameter: (0, data))
    assert release_modes(client, required=True) == "no motion mode is active"


@pytest.mark.parametrize("data", ["", "[", "[]", "null", '{"form": "0"}', '{"data": {"name": "ai"}}', "[" * 10_000])
def test_an_answer_of_another_form_says_nothing_of_the_modes(data) -> None:
    robot, client = local_pair()
    robot.serve(lambda number, parameter: (0, data))
    with pytest.raises(DeploymentError, match=r"answers '.*, which names no mode; check .* give --no-release"):
        release_modes(client, required=True)
    assert "which names no mode" in release_modes(client, required=False)
