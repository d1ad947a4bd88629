import dataclasses
import functools

import numpy as np
import pytest

from hugwbc import Gait
from hugwbc.errors import ConfigError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import Run, identity
from hugwbc.runtime.controllers import ControllerSpec, HoldController


@dataclasses.dataclass(frozen=True)
class _Row:
    x: float


@dataclasses.dataclass(frozen=True)
class _Judge:
    settle: float

    def __call__(self, index: int, run: Run) -> _Row:
        return _Row(self.settle)


def _judge(factor: float, index: int, run: Run) -> _Row:
    return _Row(factor)


def test_json_of_everything_a_cell_is_made_of():
    content = identity.to_json({"gait": Gait.WALKING, "judge": _Judge(1.0), "array": np.arange(2), "t": (1, None)})
    assert content == {
        "gait": "Gait.WALKING", "judge": {"type": "_Judge", "settle": 1.0}, "array": [0, 1], "t": [1, None]
    }  # fmt: skip
    partial = identity.to_json(functools.partial(_judge, 2.0))
    assert partial["args"] == [2.0] and partial["call"].endswith("test_identity._judge")
    for value in (lambda: 0, object(), {1, 2}):
        with pytest.raises(TypeError, match="cannot be part of a result's identity"):
            identity.to_json(value)


def test_digests_tell_apart_what_differs_and_nothing_else():
    plain, same, other = (identity.digest(Conditions(payload=p)) for p in (1.0, 1.0, 1.0 + 1e-12))
    assert plain == same != other
    assert identity.digest({"a": 1, "b": 2}) == identity.digest({"b": 2, "a": 1})


def test_motion_files_count_by_their_content(tmp_path):
    clip = tmp_path / "clip.npz"
    clip.write_bytes(b"one")
    conditions = Conditions(intervention="motion", motions=str(tmp_path))
    before = identity.digest(conditions)
    assert identity.digest(conditions) == before
    clip.write_bytes(b"two")
    assert identity.digest(conditions) != before


def test_a_judge_says_what_it_returns():
    for judge in (_Judge(1.0), functools.partial(_judge, 2.0), _judge):
        assert identity.row_type(judge) is _Row
        assert identity.judge_module(judge) == __name__
    with pytest.raises(TypeError, match="not annotated to return a dataclass"):
        identity.row_type(lambda index, run: 0)


def test_controllers_are_told_apart(tmp_path):
    identities = [identity.controller_identity(ControllerSpec(name).build) for name in ("learned", "qp", "hold")]
    assert [entry["name"] for entry in identities] == ["learned", "qp", "hold"]
    policy = tmp_path / "policy.safetensors"
    policy.write_bytes(b"other weights")
    other = identity.controller_identity(ControllerSpec("learned", policy).build)
    assert other["files"] != identities[0]["files"]
    with pytest.raises(ConfigError, match="nothing tells its controllers from others"):
        identity.controller_identity(HoldController)


def test_code_counts_where_it_is_imported_and_means_something(monkeypatch, tmp_path):
    monkeypatch.setattr(identity, "_PACKAGE", tmp_path / "hugwbc")
    (tmp_path / "hugwbc").mkdir()
    files = {name: tmp_path / "hugwbc" / f"{name}.py" for name in ("judge", "used", "unused")}
    texts = {"judge": "from hugwbc import used\n", "used": '"""Words."""\nx = 1\n', "unused": "x = 1\n"}

    def code(**changes: str) -> str:
        for name, path in files.items():
            path.write_text({**texts, **changes}[name])
        for cached in (identity._imported, identity._tree, identity._meaning):
            cached.cache_clear()
        return identity.code_identity(["hugwbc.judge", "elsewhere.module"])["code"]

    try:
        before = code()
        assert code(used='"""Other words."""\n# comment\nx =  1\n') == before
        assert code(unused="x = 2\n") == before
        assert code(used="x = 2\n") != before
        assert code(judge="from hugwbc import used\ny = 0\n") != before
        (tmp_path / "hugwbc" / "table.yaml").write_text("a: 1")
        with_table = code()
        (tmp_path / "hugwbc" / "table.yaml").write_text("a: 2")
        assert len({before, with_table, code()}) == 3, "tables next to the code count as well"
    finally:
        for cached in (identity._imported, identity._tree, identity._meaning):
            cached.cache_clear()


def test_a_name_from_a_door_counts_as_the_module_that_defines_it(monkeypatch, tmp_path):
    monkeypatch.setattr(identity, "_PACKAGE", tmp_path / "hugwbc")
    room = tmp_path / "hugwbc" / "room"
    room.mkdir(parents=True)
    texts = {
        "__init__": "from hugwbc.room.used import X as Y\nfrom hugwbc.room.unused import Z\nOWN = 1\n",
        "used": "from hugwbc.room.below import W\nX = W\n",
        "below": "W = 1\n",
        "unused": "Z = 1\n",
        "judge": "from hugwbc.room import Y\n",
        "whole": "from hugwbc.room import OWN\n",
    }
    for name, text in texts.items():
        (room / f"{name}.py").write_text(text)
    try:
        for root, files in (("judge", {"judge", "used", "below"}), ("whole", texts.keys() - {"judge"})):
            identity._imported.cache_clear()
            found = identity._imported(frozenset([f"hugwbc.room.{root}"]))
            assert {path.stem for path in found} == files, root
    finally:
        for cached in (identity._imported, identity._tree, identity._meaning):
            cached.cache_clear()


def test_a_protocol_depends_on_what_it_uses_of_the_engine():
    files = {str(path) for path in identity._imported(frozenset(["hugwbc.evaluation.protocols.small_velocities"]))}
    names = {path.rpartition("hugwbc/")[2] for path in files}
    assert {f"evaluation/engine/{name}.py" for name in ("episode", "plans")} <= names
    assert {"runtime/rollout.py", "sim/simulation.py", "evaluation/metrics.py"} <= names
    assert not names & {"evaluation/engine/campaign.py", "evaluation/protocols/tour.py"}
