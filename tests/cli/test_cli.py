import dataclasses
import json
import subprocess
import sys
import types

import pytest

from hugwbc import cli
from hugwbc.cli import evaluate, main
from hugwbc.evaluation.paper import ERROR_NAMES
from hugwbc.evaluation.protocols import PROTOCOLS

LEFT, RIGHT = ("--left-hand",), ("--right-hand", "0.3", "-0.2", "0.1")
BAD_INPUT = {
    "verb": (["evaluat"], "unknown verb 'evaluat'. Did you mean 'evaluate'?"),
    "gait": (["evaluate", "--controller", "hold", "--gait", "waking"], "gait 'waking'. Did you mean 'walking'?"),
    "gait of either leg": (["evaluate", "--controller", "hold", "--gait", "trot"], "hopping_right, hopping."),
    "controller": (["evaluate", "--controller", "qpp"], "unknown controller 'qpp'. Did you mean 'qp'?"),
    "protocol": (["evaluate", "single"], "unknown protocol 'single'"),
    "former protocol": (["evaluate", "--seed", "3", "--protocol=single"], "unknown protocol 'single'"),
    "no protocol": (["evaluate", "--seed", "3", "--protocol"], "give the name as the first word"),
    "intervention": (["evaluate", "--controller", "hold", "--intervention", "nois"], "Did you mean 'noise'?"),
    "motions": (["evaluate", "--controller", "hold", "--intervention", "motion", "--motions", "no"], "no motion files"),
    "roughness": (["evaluate", "--controller", "hold", "--terrain-roughness", "1"], "give a height from 0 to 0.5 m"),
    "long way": (["evaluate", "--controller", "hold", "--slope", "0.05", "--duration", "600"], "give up to 200 s"),
    "episodes": (["evaluate", "--controller", "hold", "--episodes", "3"], "give 8 or more: one per command"),
    "size": (["evaluate", "heatmap", "--controller", "hold", "--episodes", "3"], "it takes --points"),
    "no size": (["evaluate", "effort", "--rollouts=3"], "means nothing to the effort protocol; it takes --speeds"),
    "time step": (["evaluate", "--controller", "hold", "--timestep", "0.003"], "choose a time step that divides it"),
    "no time step": (["evaluate", "--timestep", "0", "--episodes", "9"], "time step is 0.0 s; give a value above"),
    "large time step": (["evaluate", "--controller", "hold", "--timestep", "1"], "give a value above 0"),
    "script": (["compare", "--script", "loco"], "unknown script 'loco'"),
    "script to play": (["play", "--script", "wakl"], "unknown script 'wakl'. Did you mean 'walk'?"),
    "script and command": (["play", "--script", "walk", "--v-x", "1"], "give one or the other"),
    "compared controller": (["compare", "--controllers", "hold", "holt"], "'holt'. Did you mean 'hold'?"),
    "same controller twice": (["compare", "--controllers", "hold", "hold"], "give at least one, each once"),
    "policy": (["play", "--policy", "h2", "--viewer", "none"], "unknown policy 'h2'"),
    "NaN command": (["play", "--controller", "hold", "--v-x", "nan"], "command v_x is nan; give a finite number"),
    "large command": (["play", "--controller", "hold", "--v-x", "3"], "out of range for the walking gait; valid: -0.6"),
    "moving stand": (["play", "--gait", "standing", "--v-x", "0.5"], "out of range for the standing gait"),
    "NaN hand": (["play", *LEFT, "nan", "0", "0", *RIGHT], "hand target is (nan, 0.0, 0.0); give three finite numbers"),
    "one hand": (["play", *RIGHT], "give both"),
    "duration": (["play", "--controller", "hold", "--duration", "-1"], "give a time above 0 s"),
    "duration of a live page": (["play", "--viewer", "live", "--duration", "-1"], "give a time above 0 s"),
    "live page and command": (["play", "--viewer", "live", "--h", "0"], "--viewer live and h are both given"),
    "host": (["play", "--viewer", "live", "--host", "no host"], "cannot serve on host 'no host'"),
    "port": (["play", "--viewer", "live", "--port", "99999"], "give 1 to 65535, or 0 for any that is free"),
    "seed of the noise": (["compare", "--controllers", "hold", "--seed", "-1"], "seed is -1; give 0"),
    "training folder": (["train", "--out", "/dev/null/run"], "cannot write to /dev/null/run"),
    "motions' folder": (["motions", "--out", "/dev/null/m"], "give a folder that can be written"),
    "training field": (["train", "--ppo.gamma", "2"], "ppo.gamma = 2.0; valid: above 0, up to 1"),
    "policy of the QP": (["play", "--controller", "qp", "--policy", "h1"], "controller 'qp' takes no policy"),
    "policy of no controller": (["compare", "--controllers", "hold", "--policy", "h1"], "--policy is for learned"),
    "runs to draw": (["compare", "--controllers", *"abcde"], "give 1 to 4"),
    "runs of a report": (["report", "--controllers", *(f"learned={name}" for name in "abcde")], "give 1 to 4"),
    "port of no page": (["play", "--v-x", "0", "--port", "99"], "--port is for the live page; add --viewer live"),
    "host of no page": (["play", "--v-x", "0", "--host", "::1", "--expose"], "--host, --expose is for the live page"),
    "fast contacts": (["evaluate", "contacts", "--controller", "hold", "--v-x", "9"], "v_x = 9 m/s"),
    "short walk": (["evaluate", "hands", "--duration", "1.9", "--settle", "1"], "give more than 2 s"),
    "fast hands": (["evaluate", "hands", "--v-x", "9"], "command v_x = 9 m/s is out of range"),
    "cluster": (["evaluate", "--cluster", "nowhere", "--episodes", "8"], "give host and port, such as tcp://127.0.0.1:8786"),
    "workers of the hands": (["evaluate", "hands", "--workers", "2"], "--workers means nothing to the hands protocol"),
    "benchmark of too few targets": (["bench", "--ik-targets", "1"], "ik_targets is 1; give 2 or more"),
    "benchmark of a wide grid": (["bench", "--spacing", "3"], "spacing is 3.0 m; give a distance above 0, up to 2 m"),
    "benchmark size": (["bench", "--count", "0"], "give a value above 0"),
}  # fmt: skip


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """Results go to a folder below the current one."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_says_what_to_do_and_exits_with_2(case, capsys):
    words, message = BAD_INPUT[case]
    assert main(words) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("hugwbc: ") and message in printed.err
    assert "Traceback" not in printed.err


@pytest.mark.parametrize(
    "words", [["evaluate", "--gate", "walking"], ["bench", "--count", "many"], ["play", "--vx", "1"]]
)
def test_malformed_options_exit_with_2(words, capsys):
    with pytest.raises(SystemExit) as info:
        main(words)
    assert info.value.code == 2
    assert words[1] in capsys.readouterr().err


def test_a_wrong_option_is_answered_with_the_right_one(capsys):
    with pytest.raises(SystemExit):
        main(["play", "--vx", "1"])
    assert "--v-x" in capsys.readouterr().err


def test_help_lists_every_verb(capsys):
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(verb in text for verb in cli.VERBS)
    assert main([]) == 2


@pytest.mark.parametrize("verb", cli.VERBS)
def test_every_verb_explains_itself(verb, capsys):
    with pytest.raises(SystemExit) as info:
        main([verb, "--help"])
    assert info.value.code == 0
    assert f"hugwbc {verb}" in capsys.readouterr().out


def test_evaluate_lists_its_protocols(capsys):
    with pytest.raises(SystemExit):
        main(["evaluate", "--help"])
    text = capsys.readouterr().out
    assert all(f"  {name}  " in text and protocol.summary in text for name, protocol in PROTOCOLS.items())


@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_protocol_explains_its_own_options(name, capsys):
    with pytest.raises(SystemExit) as info:
        main(["evaluate", name, "--help"])
    assert info.value.code == 0
    text = capsys.readouterr().out
    assert f"hugwbc evaluate {name}" in text and "--controller" in text
    assert ("--gait" in text) == (name != "tasks")  # they have commands of their own
    fields = {field.name for field in dataclasses.fields(PROTOCOLS[name].settings)}
    for option in ("episodes", "points", "rollouts", "samples", "blow", "training", "speeds", "v_x"):
        assert (f"--{option.replace('_', '-')} " in text) == (option in fields)
    assert ("--workers" in text) == (name not in ("hands", "forces"))
    assert all(option.help.endswith(".") for option in evaluate._options(PROTOCOLS[name]))


def test_the_former_form_of_protocols_still_works_with_a_hint(tmp_path, capsys):
    words = ["--gait", "standing", "--controller", "hold", "--duration", "0.4", "--settle", "0.1", "--episodes", "1"]
    former = [*words, "--protocol", "hands", "--results", str(tmp_path / "kept")]
    assert main(["evaluate", *former]) == 0
    printed = capsys.readouterr()
    assert "write `hugwbc evaluate hands ...`" in printed.err and not (tmp_path / "kept").exists()
    assert main(["evaluate", "hands", *words]) == 0
    again = capsys.readouterr()
    assert again.out == printed.out and "write `hugwbc" not in again.err


def test_the_module_runs_and_loads_nothing_heavy_for_help():
    heavy = ("torch", "mujoco", "placo", "pinocchio", "tyro")
    script = f"import sys; from hugwbc.cli import main; main(['-h']); print([m for m in {heavy} if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.strip().endswith("[]")
    module = subprocess.run(
        [sys.executable, "-m", "hugwbc.cli", "--version"], capture_output=True, text=True, check=True
    )
    assert module.stdout.startswith("hugwbc 0.")


def test_ctrl_c_ends_quietly(monkeypatch, capsys):
    class Verb:
        @staticmethod
        def run(words):
            raise KeyboardInterrupt

    monkeypatch.setattr(cli, "_verb", lambda name: Verb)
    assert main(["play"]) == 130
    assert capsys.readouterr().err == "hugwbc: stopped\n"


def test_evaluate_prints_the_papers_figures_and_writes_json(tmp_path, capsys):
    path = tmp_path / "new" / "out.json"
    words = ["evaluate", "--controller", "hold", "--gait", "standing", "--episodes", "3", "--seed", "3"]
    assert main([*words, "--duration", "0.4", "--settle", "0.1", "--json", str(path)]) == 0
    text = capsys.readouterr().out
    assert "paper" in text and "0.047" in text and "falls: 0 of 3 episodes" in text
    result = json.loads(path.read_text())
    assert tuple(result["errors"]) == ERROR_NAMES
    assert result["episodes"] == 3 and result["falls"] == 0 and result["seed"] == 3
    assert result["errors"]["E_h"] > 0.0 and result["errors"]["E_vx_low"] is None
    assert [row["command"] for row in result["rows"]] == ["h", "p", "w"]


def test_evaluate_keeps_results_and_reads_them_again(tmp_path, capsys):
    words = ["evaluate", "--controller", "hold", "--gait", "standing", "--episodes", "3", "--timestep", "0.005"]
    words += ["--duration", "0.4", "--settle", "0.1", "--results", "kept"]
    assert main(words) == 0
    (path,) = (tmp_path / "kept").iterdir()
    stored, printed = path.read_bytes(), capsys.readouterr().out
    assert main(words) == 0
    assert path.read_bytes() == stored and capsys.readouterr().out == printed
    assert main([*words, "--fresh"]) == 0
    assert path.read_bytes() == stored and len(list(path.parent.iterdir())) == 2
    path.write_text("something else\n")
    assert main(words) == 2
    assert "is not a file of evaluated episodes" in capsys.readouterr().err
    assert path.read_text() == "something else\n"


def test_random_commands_list_where_the_robot_falls(capsys):
    words = ["evaluate", "random-commands", "--controller", "hold", "--intervention", "noise"]
    rough = ["--terrain-roughness", "0.02", "--timestep", "0.005"]
    assert main([*words, *rough, "--episodes", "4", "--duration", "6"]) == 0
    printed = capsys.readouterr().out
    assert "falls: 4 of 4 episodes (100.0 %)" in printed
    assert "low third" in printed and "pairs with the most falls" in printed


def test_small_velocities_show_which_part_is_executed(capsys):
    words = ["evaluate", "small-velocities", "--controller", "hold", "--timestep", "0.005"]
    assert main([*words, "--episodes", "4", "--duration", "0.6", "--settle", "0.4"]) == 0
    printed = capsys.readouterr().out
    assert "executed part" in printed and "backward" in printed and "falls: 0 of 4 episodes" in printed


def test_standing_under_motions_shows_arms_and_feet(capsys):
    words = ["evaluate", "--controller", "hold", "--gait", "standing", "--intervention", "motion"]
    assert main([*words, "--episodes", "3", "--duration", "0.6", "--settle", "0.2"]) == 0
    printed = capsys.readouterr().out
    assert "0.061" in printed, "the paper's E_p under motions"
    assert "foot travel" in printed and "rad from their external targets" in printed


THREE_STANDS = (
    "evaluate --controller hold --gait standing --episodes 3 --duration 0.2 --settle 0".split()  # noqa: SIM905
)


def test_json_without_a_path_goes_to_standard_output(capsys):
    assert main([*THREE_STANDS, "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["controller"] == "hold"
    assert "paper" in printed.err


def test_json_that_cannot_be_written_is_an_error(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main([*THREE_STANDS, "--json", str(tmp_path / "file" / "out.json")]) == 2
    assert "give a path that can be written" in capsys.readouterr().err


def test_results_that_cannot_be_written_are_an_error_before_the_first_episode(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    words = ["evaluate", "--controller", "hold", "--gait", "standing", "--episodes", "3", "--duration", "2"]
    assert main([*words, "--results", str(tmp_path / "file" / "results")]) == 2
    assert "give a folder that can be written" in capsys.readouterr().err, "the store's own words come too late"


def test_hopping_is_evaluated_on_both_legs_and_a_held_foot_that_stands_shows(capsys):
    words = ["evaluate", "--controller", "hold", "--gait", "hopping", "--episodes", "8", "--timestep", "0.005"]
    assert main([*words, "--duration", "0.4", "--settle", "0.2", "--json"]) == 0
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert result["gait"] == "hopping" and {row["gait"] for row in result["rows"]} == {"hopping_left", "hopping_right"}
    assert result["paper"]["E_h"] == 0.103
    assert "held foot on the ground: 100.0 % of the time" in printed.err


@pytest.mark.parametrize(
    "words",
    [
        ["compare", "--script", "loco", "--out", "new", "--json", "other/out.json"],
        ["compare", "--controllers", "holt", "--out", "new"],
        ["evaluate", "single", "--json", "new/out.json"],
        ["evaluate", "--controller", "hold", "--episodes", "3", "--json", "new/out.json"],
        ["report", "--workers", "0", "--out", "new"],
        ["bench", "--calls", "0", "--json", "new/out.json"],
    ],
)
def test_what_is_refused_leaves_no_folder_behind(words, tmp_path, capsys):
    assert main(words) == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("buffered", [True, False])
def test_a_reader_who_has_enough_is_no_error(buffered: bool) -> None:
    words = [sys.executable, *([] if buffered else ["-u"]), "-m", "hugwbc.cli", "evaluate", "hands", "--help"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0


def test_the_words_above_the_options_are_not_indented(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["tasks", "--help"])
    assert "\n`hugwbc play --task NAME`" in capsys.readouterr().out


def test_a_wrong_renderer_is_named(monkeypatch, capsys):
    def refuse(_words):
        raise RuntimeError("invalid value for environment variable MUJOCO_GL: mesa")

    monkeypatch.setattr(cli, "_verb", lambda _: types.SimpleNamespace(run=refuse))
    assert main(["compare"]) == cli.USAGE_ERROR
    assert "MUJOCO_GL: mesa; valid: egl, osmesa or glfw" in capsys.readouterr().err
