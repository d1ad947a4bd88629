"""Stored episodes are of the contents of everything that was read for them, however deep a file names another."""

import pathlib
import re
import shutil

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from hugwbc.cli import main
from hugwbc.errors import ConfigError
from hugwbc.evaluation import episode
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.episode import CountedSettings
from hugwbc.evaluation.experiment import run_experiment
from hugwbc.evaluation.experiments import experiment_of
from hugwbc.evaluation.experiments.behaviours import BEHAVIOURS as EXPERIMENT
from hugwbc.evaluation.plans import Plan
from hugwbc.evaluation.store import Store, StoredTable, table_key
from hugwbc.robot_tables import models_dir
from hugwbc.runtime.controllers import ControllerSpec

HOLD = ControllerSpec("hold")
THING = """<mujoco><asset><mesh name="w" file="wedge.obj"/></asset><include file="more.xml"/><worldbody><body name="b">
<freejoint/><geom type="mesh" mesh="w" mass="{}"/></body></worldbody></mujoco>"""
WEDGE = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
MORE = '<mujoco><worldbody><body name="c" pos="0 {} 0"><geom size=".1"/></body></worldbody></mujoco>'
STAND = (
    "from hugwbc.behaviours import stand\nimport beside\ndef still(view):\n    return (yield from stand(view, 0.1))\n"
)
MEASURE = """
import pathlib
import numpy as np
from hugwbc.evaluation.episode import CountedSettings
from hugwbc.evaluation.experiment import Experiment, numbered
from hugwbc.scripts import load_script
import near

HERE = pathlib.Path(__file__).parent
ONCE = np.loadtxt(HERE / "once.csv")

def measure(controller, settings, plan):
    script, own = load_script(HERE / "script.yaml"), np.loadtxt(HERE / "own.csv")
    return {"once": float(ONCE), "x": near.VALUE, "end": float(script.hands_at(2.0).left[0]), "own": float(own)}

MINE = Experiment("mine", "", CountedSettings, numbered, measure, lambda settings, rows: [])
"""
LAZY = """
import functools
import pathlib
import numpy as np
from hugwbc.evaluation.episode import CountedSettings
from hugwbc.evaluation.experiment import Experiment, numbered
from hugwbc.runtime import HoldController

class Lazy(HoldController):
    @functools.cached_property
    def gain(self):
        return float(np.loadtxt(pathlib.Path(__file__).parent / "gain.csv"))

def measure(controller, settings, plan):
    return {"gain": controller.gain}

MINE = Experiment("mine", "", CountedSettings, numbered, measure, lambda settings, rows: [])
"""
SCRIPT = "segments: [{label: a, duration: 3, hands: {frame: pelvis, left: {file: hand.csv}}}]"


@pytest.fixture
def played(monkeypatch):
    """The scenes of the episodes of behaviours that are simulated."""
    seen, whole = [], episode.rollout
    monkeypatch.setattr(episode, "rollout", lambda *a, **k: (seen.append(a[2].scene), whole(*a, **k))[1])
    return seen


def test_a_changed_file_that_a_scenes_file_names_runs_again(tmp_path: pathlib.Path, played, monkeypatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    texts = {
        "scene.yaml": "objects: [{{name: k, mjcf: thing.xml, position: [{}, 0]}}]",
        "thing.xml": THING, "wedge.obj": WEDGE, "more.xml": MORE, "beside.py": "x = {}",
    }  # fmt: skip
    for name, text in texts.items():
        (tmp_path / name).write_text(text.format(3))
    (tmp_path / "mine.py").write_text(STAND)
    command = ["evaluate", "behaviours", "--controller", "hold", "--behaviour", f"{tmp_path / 'mine.py'}:still"]
    command += ["--scene", str(tmp_path / "scene.yaml"), "--episodes", "1", "--duration", "0.2"]
    command += ["--results", str(tmp_path / "rows")]
    for _ in range(2):
        assert main(command) == 0 and len(played) == 1
    for number, (name, text) in enumerate(texts.items(), start=2):
        (tmp_path / name).write_text(text.format(2.5))
        assert main(command) == 0 and len(played) == number, name
    (tmp_path / "unrelated.xml").write_text("")
    assert main(command) == 0 and len(played) == 1 + len(texts)


def test_a_changed_file_that_only_an_episode_reads_makes_it_run_again(tmp_path: pathlib.Path, monkeypatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "mine.py").write_text(MEASURE)
    (tmp_path / "script.yaml").write_text(SCRIPT)
    texts = {
        "near.py": "VALUE = {}",
        "hand.csv": "t,x,y,z\n0,0.3,0.2,0\n2,{},0.2,0\n",
        "own.csv": "{}",
        "once.csv": "{}",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text.format(0.25))

    def row() -> list[float]:
        settings = CountedSettings(duration=0.2, settle=0.1)
        result = run_experiment(experiment_of(f"{tmp_path / 'mine.py'}:MINE"), settings, HOLD, store=Store(tmp_path))
        return [result.rows[0][name] for name in ("x", "end", "own", "once")]

    expected = [0.25, 0.25, 0.25, 0.25]
    assert row() == expected
    for place, (name, text) in enumerate(texts.items()):
        (tmp_path / name).write_text(text.format(0.375))
        expected[place] = 0.375
        assert row() == row() == expected, name


def test_what_a_controller_reads_in_its_first_episode_counts_for_all(tmp_path: pathlib.Path) -> None:
    (tmp_path / "lazy.py").write_text(LAZY)

    def rows() -> list[float]:
        settings, own = CountedSettings(episodes=2, duration=0.2, settle=0.1), f"{tmp_path / 'lazy.py'}:"
        spec, experiment = ControllerSpec(f"{own}Lazy"), experiment_of(f"{own}MINE")
        return [row["gain"] for row in run_experiment(experiment, settings, spec, store=Store(tmp_path)).rows]

    for gain in (1.0, 2.0):
        (tmp_path / "gain.csv").write_text(str(gain))
        assert rows() == rows() == [gain, gain]


def test_a_robots_table_counts_and_its_path_is_no_folder_of_rows(tmp_path: pathlib.Path) -> None:
    keys = []
    for height in (0.757, 0.759):
        folder = tmp_path / str(height) / "mine"
        shutil.copytree(models_dir() / "g1", folder)
        table = re.sub("nominal_height: [0-9.]+", f"nominal_height: {height}", (folder / "g1.yaml").read_text())
        (folder / "mine.yaml").write_text(table)
        (folder / "g1.yaml").unlink()
        settings = CountedSettings(conditions=Conditions(robot=str(folder)))
        spec = ControllerSpec("qp", robot=str(folder))
        keys.append(table_key("x", EXPERIMENT.episode, settings, spec))
        path = Store(tmp_path / "rows").table("x", EXPERIMENT.episode, settings, spec).path
        assert path is not None and path.parent == tmp_path / "rows" and path.name.startswith("x-qp_mine-")
    assert keys[0]["arenas"] != keys[1]["arenas"]


def test_a_policys_weights_in_another_file_count(tmp_path: pathlib.Path) -> None:
    weights = numpy_helper.from_array(np.zeros((3, 10), np.float32), "w")
    values = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, k]) for n, k in (("obs", 3), ("action", 10))]
    node = helper.make_node("MatMul", ["obs", "w"], ["action"])
    graph = helper.make_graph([node], "g", [values[0]], [values[1]], [weights])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    path = tmp_path / "net.onnx"
    onnx.save(model, str(path), save_as_external_data=True, location="net weights.bin", size_threshold=0)
    shipped = (
        pathlib.Path(experiment_of.__code__.co_filename).parents[3] / "models/h1/policies/unitree-h1/contract.yaml"
    )
    text = shipped.read_text().partition("observation:")[0] + "observation: [gravity]\npolicy: net.onnx\n"
    (tmp_path / "mine.yaml").write_text(text)
    spec = ControllerSpec(str(tmp_path / "mine.yaml"))
    assert spec.build().period == 0.02 and len(spec.files()) == 3
    before = spec.identity()
    (tmp_path / "net weights.bin").write_bytes(np.ones(30, np.float32).tobytes())
    assert spec.identity() != before


def test_a_damaged_table_is_refused_before_it_is_measured_afresh(tmp_path: pathlib.Path) -> None:
    key = {"experiment": "mine", "files": {}}
    StoredTable(tmp_path / "a.jsonl", key).add(Plan(0), {"x": 1.0})
    (tmp_path / "a.jsonl").write_text((tmp_path / "a.jsonl").read_text().replace("mine", "mime"))
    with pytest.raises(ConfigError, match="not a table of episodes"):
        StoredTable(tmp_path / "a.jsonl", key, fresh=True)


def test_a_row_of_other_than_plain_numbers_is_refused_by_its_columns() -> None:
    row = {"x": np.float64(1.0), "fell": np.bool_(False), "path": np.zeros(3), "n": 3, "why": None}
    with pytest.raises(ConfigError, match=r"of 'mine' gives fell \(bool\), path \(ndarray\), which is no plain"):
        StoredTable(None, {"experiment": "mine", "files": {}}).add(Plan(0), row)
