import json
import pathlib

import numpy as np
import pytest

from hugwbc.errors import PolicyFileError
from hugwbc.learned.config import TrainConfig
from hugwbc.learned.policy import observations as obs
from hugwbc.learned.policy.policy_contract import complete_contract, policy_contract, settings_record
from hugwbc.robot import load_robot


def test_layouts_have_the_sizes_of_the_networks() -> None:
    contract = policy_contract()
    sizes = {key: sum(part["size"] for part in contract[key]) for key in ("proprioception", "command", "estimate")}
    assert sizes == {"proprioception": obs.PROPRIOCEPTION_SIZE, "command": obs.COMMAND_SIZE, "estimate": 6}


def test_own_settings_are_carried() -> None:
    contract = complete_contract(policy_contract(period=0.01, action_scale=0.4, waist_rate=0.0), "x")
    assert (contract["period"], contract["action_scale"], contract["waist_rate"]) == (0.01, [0.4] * 19, 0.0)


def test_the_record_of_the_settings_holds_no_folder_of_a_machine() -> None:
    here = pathlib.Path("/home/somebody/runs")
    config = TrainConfig(out=here / "mine", start_from=here / "first" / "snapshot.safetensors")
    record = settings_record(config)
    assert "out" not in record and record["start_from"] == "first/snapshot.safetensors"
    assert "somebody" not in json.dumps(record)


def test_every_joint_may_have_its_own_scale_and_gains() -> None:
    scale, kd = np.linspace(0.1, 0.3, 19), np.full(19, 7.0)
    contract = complete_contract(policy_contract(action_scale=scale, kd=kd), "x")
    assert contract["action_scale"] == scale.tolist() and contract["kd"] == kd.tolist()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("history_frames", 6),
        ("gait", {}),
        ("action_scale", float("nan")),
        ("action_scale", 0.0),
        ("action_scale", True),
        ("period", None),
        ("waist_rate", "2"),
        ("kp", [1.0]),
        ("kd", [-1.0] * 19),
        ("nominal", None),
    ],
)
def test_entries_that_cannot_be_run_are_refused(key: str, value: object) -> None:
    with pytest.raises(PolicyFileError, match=f"the_file has {key}"):
        complete_contract(policy_contract() | {key: value}, "the_file")


def test_another_version_of_the_contract_is_refused() -> None:
    with pytest.raises(PolicyFileError, match="version 99, this hugwbc reads 2"):
        complete_contract(policy_contract() | {"contract": 99}, "x")


def test_a_policy_says_on_which_robot_it_was_trained() -> None:
    contract = complete_contract(policy_contract(robot=load_robot("h1-2023")), "x")
    assert contract["robot"] == "h1-2023"
    with pytest.raises(PolicyFileError, match=r"the_file has robot = g1, .* knows h1, h1-2023"):
        complete_contract(contract | {"robot": "g1"}, "the_file")
