import json

import numpy as np
import onnx
import pytest

from hugwbc.cli import main
from hugwbc.commands import Command
from hugwbc.controller import UpperBody
from hugwbc.errors import ConfigError, PolicyFileError, UnknownNameError
from hugwbc.gait import Gait
from hugwbc.learned.policy import load_policy
from hugwbc.learned.policy.network_policy import load_onnx_policy
from hugwbc.runtime import ControllerSpec
from hugwbc.state import RobotState


def test_what_another_project_says_of_its_training_is_no_matter(exported_h1, tmp_path):
    model = onnx.load(exported_h1)
    model.metadata_props[1].value = "my run 7"
    onnx.save(model, tmp_path / "theirs.onnx")
    theirs = ControllerSpec(str(tmp_path / "theirs.onnx"))
    assert theirs.build().name == "learned" and theirs.training is None
    del model.metadata_props[0]
    onnx.save(model, tmp_path / "theirs.onnx")
    for words in ((str(tmp_path / "theirs.onnx"),), ("learned", tmp_path / "theirs.onnx")):
        with pytest.raises(PolicyFileError, match="is a bare network"):
            ControllerSpec(*words)


def changed(exported, path, change):
    """Write a copy of the exported file whose contract was changed."""
    model = onnx.load(exported)
    entry = model.metadata_props[0]
    contract = json.loads(entry.value)
    entry.value = change(contract) or json.dumps(contract)
    onnx.save(model, path)
    return str(path)


def test_the_exported_policy_gives_the_joint_targets_of_the_policy(exported_h1):
    rng = np.random.default_rng(0)
    policy, other = load_policy(), load_onnx_policy(exported_h1)
    worst = 0.0
    for step in range(60):
        orientation = np.array([1.0, *(0.2 * rng.standard_normal(3))])
        state = RobotState(
            policy.robot.nominal + 0.2 * rng.standard_normal(19),
            rng.standard_normal(19),
            orientation / np.linalg.norm(orientation),
            rng.standard_normal(3),
        )
        if step == 0:
            policy.reset(state)
            other.reset(state)
        gait = Gait(step // 12)
        command = Command(v_x=0.4 * (gait is not Gait.STANDING), h=-0.1, p=0.1, w=0.3, gait=gait)
        arms = UpperBody.targets(rng.uniform(-0.5, 0.5, 8)) if step % 3 == 2 else UpperBody.none()
        one, two = (controller.act(state, command, arms) for controller in (policy, other))
        worst = max(worst, float(np.abs(one.q - two.q).max()))
        assert np.array_equal(one.kp, two.kp) and np.array_equal(one.kd, two.kd) and policy.phase == other.phase
    assert worst < 1e-5, worst  # [rad]


def test_it_is_a_controller_by_its_path(exported_h1):
    spec = ControllerSpec(str(exported_h1))
    assert spec.label == "h1" and spec.training == load_policy().training["config"]["env"]["intervention"]
    assert spec.build().name == "learned" and ControllerSpec("learned", str(exported_h1)).build().period == 0.02
    words = ["--viewer", "none", "--duration", "0.2", "--v-x", "0.3"]
    assert main(["play", "--controller", str(exported_h1), *words]) == 0
    with pytest.raises(ConfigError, match="takes no policy because it is one"):
        ControllerSpec(str(exported_h1), "h1")


def test_what_is_no_exported_policy_is_refused(exported_h1, tmp_path):
    path = tmp_path / "other.onnx"
    with pytest.raises(UnknownNameError, match="policy"):
        ControllerSpec(str(path))
    path.write_bytes(b"nothing")
    with pytest.raises(PolicyFileError, match="is not an ONNX network"):
        ControllerSpec(str(path))
    model = onnx.load(exported_h1)
    del model.metadata_props[:]
    onnx.save(model, path)
    with pytest.raises(PolicyFileError, match=r"is a bare network: it has no contract .* docs/evaluation.md"):
        ControllerSpec(str(path))
    for change, message in (
        (lambda contract: "[]", "has no contract"),
        (lambda contract: "{", "is not JSON"),
        (lambda contract: contract.update(robot="g9"), "unknown robot 'g9'"),
        (lambda contract: contract.update(period=-1.0), "period"),
        (lambda contract: contract.update(memory=3), "unknown Contract field 'memory'"),
    ):
        with pytest.raises(PolicyFileError, match=message):
            ControllerSpec(changed(exported_h1, path, change)).build()
