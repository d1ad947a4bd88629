import json
import re
import signal
import subprocess
import sys
import types

import pytest

from hugwbc import cli
from hugwbc.cli import main
from hugwbc.evaluation.experiments import EXPERIMENTS

BAD_INPUT = {
    "verb": (["evaluat"], "unknown verb 'evaluat'. Did you mean 'evaluate'?"),
    "controller": (["evaluate", "--controller", "qpp"], "unknown controller 'qpp'. Did you mean 'qp'?"),
    "experiment": (["evaluate", "single"], "unknown experiment 'single'"),
    "script to play": (["play", "--script", "wakl"], "unknown script 'wakl'. Did you mean 'walk'?"),
    "script and command": (["play", "--script", "walk", "--v-x", "1"], "give one or the other"),
    "compared controller": (["compare", "--controllers", "hold", "holt"], "'holt'. Did you mean 'hold'?"),
    "NaN command": (["play", "--controller", "hold", "--v-x", "nan"], "command v_x is nan; give a finite number"),
    "one hand": (["play", "--right-hand", "0.3", "-0.2", "0.1"], "give both"),
    "duration": (["play", "--controller", "hold", "--duration", "-1"], "duration is -1.0; it should"),
    "live page and command": (["play", "--viewer", "live", "--h", "0"], "--viewer live and --h are both given"),
    "host": (["play", "--viewer", "live", "--host", "no host"], "cannot serve on host 'no host'"),
    "port": (["play", "--viewer", "live", "--port", "99999"], "it should be less than or equal to 65535"),
    "training folder": (["train", "--out", "/dev/null/run"], "cannot write /dev/null/run"),
    "processes": (["train", "--processes", "0"], "processes is 0; give 1 to"),
    "policy of the QP": (["play", "--controller", "qp", "--policy", "h1"], "controller 'qp' takes no policy"),
    "runs to draw": (["compare", "--controllers", *"abcde"], "give 1 to 4"),
    "port of no page": (["play", "--v-x", "0", "--port", "99"], "--port is for the live page; add --viewer live"),
    "host of no page": (["play", "--v-x", "0", "--host", "::1", "--expose"], "--host, --expose is for the live page"),
    "cluster": (["evaluate", "--cluster", "nowhere", "--episodes", "8"], "no Dask scheduler answers at nowhere"),
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


def test_evaluate_lists_its_experiments(capsys):
    with pytest.raises(SystemExit):
        main(["evaluate", "--help"])
    text = capsys.readouterr().out
    assert all(f"  {name}  " in text and experiment.summary in text for name, experiment in EXPERIMENTS.items())


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_option_of_an_experiment_has_an_explanation_of_its_own(name, capsys):
    with pytest.raises(SystemExit):
        main(["evaluate", name, "--help"])
    words = " ".join(line.strip("│ ") for line in capsys.readouterr().out.splitlines())
    pieces = [piece for piece in re.split(r"(?:, | )--(?=[a-z])", words) if "(default: " in piece]
    values = r"(?:\S*[A-Z]{3}\S*(?: \S+ \.\.\.\]+)?|\{\S*\})?"  # FLOAT, {None}|STR, [FLOAT [FLOAT ...]], {None,noise}
    said = dict(re.match(rf"(\S+) {values} *(.*?) *\(default: ", piece).groups() for piece in pieces)
    assert {"seed", "duration", "settle", "gait"} <= set(said)
    assert not [option for option, text in said.items() if not text or list(said.values()).count(text) > 1]


def test_the_module_runs_and_loads_nothing_heavy_for_help():
    heavy = ("torch", "mujoco", "placo", "pinocchio", "tyro", "hugwbc.table_form")
    script = f"import sys; from hugwbc.cli import main; main(['-h']); print([m for m in {heavy} if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.strip().endswith("[]")
    module = subprocess.run(
        [sys.executable, "-m", "hugwbc.cli", "--version"], capture_output=True, text=True, check=True
    )
    assert module.stdout.startswith("hugwbc 0.")


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_sigterm_and_a_lost_terminal_end_quietly(sent, monkeypatch, capsys):
    before = signal.getsignal(sent)
    verb = types.SimpleNamespace(run=lambda words: signal.raise_signal(sent))
    monkeypatch.setattr(cli, "_verb", lambda name: verb)
    assert main(["play"]) == 130
    assert capsys.readouterr().err == "hugwbc: stopped\n"
    assert signal.getsignal(sent) is before


def test_with_nohup_a_lost_terminal_ends_nothing(monkeypatch):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        monkeypatch.setattr(cli, "_verb", lambda name: types.SimpleNamespace(run=lambda w: signal.raise_signal(1) or 0))
        assert main(["play"]) == 0
    finally:
        signal.signal(signal.SIGHUP, before)


def test_evaluate_prints_the_papers_figures_and_writes_json(tmp_path, capsys):
    path = tmp_path / "new" / "out.json"
    words = ["evaluate", "--controller", "hold", "--gait", "standing", "--episodes", "3", "--seed", "3"]
    assert main([*words, "--duration", "0.4", "--settle", "0.1", "--json", str(path)]) == 0
    text = capsys.readouterr().out
    assert "paper" in text and "0.047" in text and "3 episodes, seed 3 (selection)" in text
    assert "Not the default: duration 0.4, settle 0.1, gait standing." in text
    result = json.loads(path.read_text())
    values = {figure["quantity"]: figure["estimate"]["value"] for figure in result["figures"]}
    assert values["E_h"] > 0.0 and values["falls"] == 0.0 and result["settings"]["seed"] == 3
    assert result["seed_class"] == "selection" and result["commit"]
    assert [row["command"] for row in result["rows"]] == ["h", "p", "w"]


def test_evaluate_names_no_setting_that_follows_from_the_controller(capsys):
    words = ["evaluate", "intervention", "--controller", "hold", "--gait", "standing", "--episodes", "9"]
    assert main([*words, "--duration", "0.4", "--settle", "0.1", "--results", "None"]) == 0
    text = capsys.readouterr().out
    assert "trained with noise" in text and "Not the default: duration 0.4, settle 0.1, gait standing." in text


def test_evaluate_keeps_results_and_reads_them_again(tmp_path, capsys):
    words = ["evaluate", "--controller", "hold", "--gait", "standing", "--episodes", "3", "--timestep", "0.005"]
    words += ["--duration", "0.4", "--settle", "0.1", "--results", "kept"]
    assert main(words) == 0
    (path,) = (tmp_path / "kept").iterdir()
    stored, printed = path.read_bytes(), capsys.readouterr().out
    assert main(words) == 0
    assert path.read_bytes() == stored and capsys.readouterr().out == printed
    assert main([*words, "--fresh"]) == 0
    assert len(path.read_bytes().splitlines()) == 7 and capsys.readouterr().out == printed, "new rows take their place"
    path.write_text("something else\n")
    assert main(words) == 2
    assert "is not a table of episodes" in capsys.readouterr().err
    assert path.read_text() == "something else\n"


THREE_STANDS = (
    "evaluate --controller hold --gait standing --episodes 3 --duration 0.2 --settle 0".split()  # noqa: SIM905
)


def test_json_without_a_path_goes_to_standard_output(capsys):
    assert main([*THREE_STANDS, "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["controller"] == "hold"
    assert "paper" in printed.err


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
    words = [sys.executable, *([] if buffered else ["-u"]), "-m", "hugwbc.cli", "docs", "evaluation"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0


def test_a_wrong_renderer_is_named(monkeypatch, capsys):
    def refuse(_words):
        raise RuntimeError("invalid value for environment variable MUJOCO_GL: mesa")

    monkeypatch.setattr(cli, "_verb", lambda _: types.SimpleNamespace(run=refuse))
    assert main(["compare"]) == cli.USAGE_ERROR
    assert "MUJOCO_GL: mesa; valid: egl, osmesa or glfw" in capsys.readouterr().err
