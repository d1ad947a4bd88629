"""Run what the tables of the documents show, on one commit, and write the tables into the documents.

    python tools/results.py [--workers 2] [--only walking hands] [--quick] [--check] [--public FOLDER] [--policy FILE]

A table stands between two comments, `<!-- results: NAME COMMIT -->` and `<!-- end -->`, and is never typed. Finished
episodes are stored in out/evaluation: after a kill, the same command goes on. `--check` runs nothing, and fails if a
table belongs to other commands, or to another commit than the last one that changed what runs (`hugwbc.source`).
`--policy` prints the H1's tables of a policy that is not shipped.
"""

import argparse
import dataclasses
import itertools
import pathlib
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence

from hugwbc.cli.evaluate import parse_entry
from hugwbc.cli.output import progress
from hugwbc.evaluation.execution import Execution
from hugwbc.evaluation.experiments.forces import ENDED
from hugwbc.evaluation.experiments.intervention import DISPLACEMENT
from hugwbc.evaluation.figures import FALLS, Comparison, Figure
from hugwbc.evaluation.intervals import FEW
from hugwbc.evaluation.store import Store
from hugwbc.evaluation.study import Entry, each_result
from hugwbc.files import write_whole
from hugwbc.learned.policy import POLICY_FILE
from hugwbc.settings import REPORT_SEED, SELECTION_SEED
from hugwbc.source import short_commit

ROOT = pathlib.Path(__file__).resolve().parents[1]
ERRORS = ("E_vx", "E_vx_low", "E_vx_high", "E_vy", "E_omega", "E_f", "E_l", "E_h", "E_p", "E_w")
FIRST = ("E_vx_low", "E_vx_high", "E_omega", "E_l", FALLS)  # of the first page
FEET = (
    "touch-down speed, median",
    "peak foot force of 10 ms, mean of stances",
    "hops per second, difference to the clock",
    "held foot on the ground",
)
HANDS = ("hand error, mean", "hand error, 95th percentile", "arm joints' error", FALLS)
HEADLINES = (
    "E_vx_low",
    "E_omega",
    "E_l",
    "cost of transport",
    "hand error, mean",
    "arrived",
    "time",
    "median of all",
    ENDED,
    "success",
    FALLS,
)
FAILED = "failed"  # one column for all reasons, which are figures of their own
OUTCOMES = ("success", "time of a success", "score", "hand acceleration of a success", "energy of a success", FAILED)
GROUND = ("went well", "noticed after, at most", "speed at the ground", "speed at the ground, at most")
IN_PHYSX = (
    *(f"E_{name}, {kind}" for name in ("v_x", "v_y", "omega") for kind in ("mujoco", "ratio")),
    *(f"{FALLS}, {engine}" for engine in ("mujoco", "physx")),
)
GAITS = {"standing": 64, "walking": 128, "jumping": 128, "hopping": 64}
SHORT = "--episodes 8 --duration 4"
QUICK = {  # by experiment, what it takes instead with --quick; one episode of each case where nothing is said
    "single-command": SHORT,
    "random-commands": SHORT,
    "response": "--points 3 --duration 4",
    "estimation": "--episodes 4 --duration 4",
    "contacts": "--episodes 4",
    "arrive": "--episodes 4",
    "engines": "--episodes 1 --duration 8",
    "boxes": "--episodes 1 --masses 2 6",
    "intervention": "--episodes 24 --duration 4",
    "disturbance": "--rollouts 1 --first 100 --resolution 0.5 --duration 3",
}
BOTH = {"QP": "qp", "learned": "learned"}
PUBLIC = {  # other projects' policies, each with its contract and its file in the folder of --public
    "unitree_rl_gym's H1": ("unitree-h1", "unitree-h1.pt"),
    "LeggedLabDeploy's H1": ("leggedlab-h1", "leggedlab-h1.pt"),
    "unitree_rl_gym's G1": ("unitree-g1", "unitree-g1.pt"),
    "LeggedLabDeploy's G1": ("leggedlab-g1", "leggedlab-g1.pt"),
    "unitree_rl_lab's G1": ("unitree-lab-g1", "unitree-lab-g1.onnx"),
    "holosoma's G1 (FastSAC)": ("holosoma-g1", "holosoma-g1.onnx"),
    "holosoma's G1 (PPO)": ("holosoma-g1", "holosoma-ppo-g1.onnx"),
    "MuJoCo Playground's G1": ("playground-g1", "playground-g1.onnx"),
}
PUBLIC_CONTROLLERS = "tools/public_controllers.py"
WHOLE_BODY = BOTH | {  # what moves a G1 while its arms are moved from outside
    name.upper(): f"{PUBLIC_CONTROLLERS}:{name} --policy {{public}}/{name.lower()}-g1.onnx"
    for name in ("Homie", "Falcon")
}
POLICIES = "models/h1/policies"
STANDS = "72 --duration 21"  # episodes of the ablation, 20 s as the paper's after the settling time
PATHS = tuple(f"{DISPLACEMENT.format(name)}{part}" for name in "hpw" for part in ("", ", creep in it"))
ABLATION = ("h1-noise", "h1-motion", "h1-none", "h1-plain")  # what moved the arms in training; plain: no symmetry


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of the documents.

    Attributes:
        documents: where it stands, relative to the root of the repository.
        runs: by label, the words of `hugwbc evaluate` without the seed; of several experiments with "; " between them.
        quantities: names of the figures, in order; all that the runs have if empty.
        tall: a row for each quantity and a column for each label, instead of the other way round.
    """

    documents: tuple[str, ...]
    runs: dict[str, str]
    quantities: tuple[str, ...] = ()
    tall: bool = False


def _tracking(*gaits: str, further: str = "") -> dict[str, str]:
    """Return runs of single commands for both controllers in some gaits, with further options."""
    return {
        f"{label}, {gait}": f"single-command --controller {name} --gait {gait} --episodes {GAITS[gait]}{further}"
        for gait in gaits
        for label, name in BOTH.items()
    }


def _both(words: str) -> dict[str, str]:
    """Return runs for each controller, whose name takes the place of {}."""
    return {label: words.format(name) for label, name in BOTH.items()}


def _ablation(words: str) -> dict[str, str]:
    """Return runs of an experiment for each policy of the ablation."""
    return {policy: f"{words} --controller {policy}" for policy in ABLATION}


def _g1(words: str, *gaits: str) -> dict[str, str]:
    """Return runs of an experiment in some gaits for a G1 with each controller."""
    return {
        f"G1, {label}, {gait}": f"{words} --robot g1 --controller {name} --gait {gait}"
        for gait in gaits
        for label, name in BOTH.items()
    }


RESULTS = ("docs/results.md",)
G1 = ("models/g1/README.md",)
G1_COMMANDS = "single-command --episodes 64"


def _compared(controller: str, *, walks: int = 128, layouts: int = 50) -> str:
    """Return the runs of the comparison for a controller, whose name may have further options behind it."""
    words = (
        f"single-command --controller {controller} --gait walking --episodes {walks}",
        f"random-commands --controller {controller} --episodes 64",
        f"contacts --controller {controller} --gait walking --episodes 20",
        f"hands --controller {controller} --gait walking",
        f"arrive --controller {controller} --episodes 20",
        f"stops --controller {controller}",
        f"push --controller {controller}",
        f"tasks --controller {controller} --episodes {layouts}",
    )
    return "; ".join(words)


TABLES = {
    "walking": Table(("README.md",), _tracking("walking") | _g1(G1_COMMANDS, "walking"), FIRST),
    "single-commands": Table(RESULTS, _tracking(*GAITS), (*ERRORS, FALLS)),
    "feet": Table(RESULTS, _tracking("walking", "jumping", "hopping"), FEET),
    "random-commands": Table(RESULTS, _both("random-commands --controller {} --episodes 64"), (*ERRORS, FALLS)),
    "arm-motion": Table(
        RESULTS,
        {
            f"learned, {kind}": f"single-command --controller learned --intervention {kind} --episodes 128"
            for kind in ("noise", "motion")
        },
        (*ERRORS, FALLS),
    ),
    "other-robot": Table(RESULTS, _tracking(*GAITS, further=" --robot h1-2023"), (*ERRORS, FALLS)),
    "told-wrong": Table(
        RESULTS, _tracking("standing", "walking", "hopping", further=" --told h1-2023"), (*ERRORS, FALLS)
    ),
    "public": Table(
        RESULTS,
        {
            label: f"single-command --robot {contract.rpartition('-')[2]} --controller {contract}"
            f" --policy {{public}}/{file} --episodes 128"
            for label, (contract, file) in PUBLIC.items()
        },
        (*ERRORS[:5], FALLS),  # they have no other commands
    ),
    "whole-body": Table(
        ("docs/comparison.md",),
        {
            label: "; ".join(
                f"intervention --robot g1 --gait {gait} --episodes {episodes} --controller {controller}"
                for gait, episodes in (("standing", 72), ("walking", 192))  # eight of each cell
            )
            for label, controller in WHOLE_BODY.items()
        },
        ("E_vx", "E_vy", "E_omega", "E_h", "E_w", FALLS),  # neither HOMIE nor FALCON has other commands
    ),
    "whole-body-tasks": Table(
        ("docs/comparison.md",),
        {
            label: f"tasks --robot g1 --episodes 10 --controller {controller}"
            for label, controller in WHOLE_BODY.items()
        },
        ("success",),
        tall=True,
    ),
    **{
        f"ablation-{gait}": Table(RESULTS, _ablation(f"intervention --gait {gait} --episodes {size}"), (*ERRORS, FALLS))
        for gait, size in {"standing": STANDS, "walking": 192, "jumping": 192}.items()  # eight of each cell
    },
    "foot-displacement": Table(
        RESULTS, _ablation(f"intervention --gait standing --episodes {STANDS}"), (*PATHS, FALLS)
    ),
    "disturbance": Table(RESULTS, _ablation("disturbance")),
    "response": Table(RESULTS, _both("response --controller {}"), tall=True),
    "hands": Table(
        RESULTS,
        {
            f"{label}, {gait}": f"hands --controller {name} --gait {gait}"
            for gait in ("standing", "walking")
            for label, name in BOTH.items()
        },
        HANDS,
    ),
    "estimation": Table(RESULTS, _both("estimation --controller {} --episodes 50 --duration 6"), tall=True),
    "engines": Table(("docs/physx.md",), _both("engines --controller {} --episodes 10"), IN_PHYSX),
    "tasks": Table(("docs/tasks.md",), _both("tasks --controller {} --episodes 50"), OUTCOMES),
    "boxes": Table(
        ("docs/tasks.md",),
        _both("boxes --controller {} --episodes 20"),
        tuple(f"done from {height} m" for height in (0.3, 0.6, 0.9)),
    ),
    "comparison": Table(
        ("docs/comparison.md",),
        {
            **{label: _compared(name) for label, name in BOTH.items()},
            **{f"G1 {label}": _compared(f"{name} --robot g1", walks=64, layouts=10) for label, name in BOTH.items()},
        },
        HEADLINES,
        tall=True,
    ),
    "carry": Table(("docs/forces.md",), _both("carry --controller {} --episodes 4"), tall=True),
    "pull": Table(("docs/forces.md",), _both("pull --controller {} --gait walking --force 30"), tall=True),
    "press": Table(("docs/forces.md",), _both("press --controller {}"), tall=True),
    "push": Table(("docs/forces.md",), _both("push --controller {}"), tall=True),
    "sway": Table(("docs/forces.md",), _both("sway --controller {}"), tall=True),
    "faults": Table(("docs/reliability.md",), _both("faults --controller {} --episodes 10"), GROUND),
    "g1": Table(G1, _g1(G1_COMMANDS, "standing", "walking", "jumping"), (*ERRORS, FALLS)),
    "g1-hands": Table(G1, _g1("hands", "standing", "walking"), HANDS),
    "g1-tasks": Table(
        G1,
        {f"G1, {label}": f"tasks --robot g1 --controller {name} --episodes 10" for label, name in BOTH.items()},
        OUTCOMES,
    ),
    "stops": Table(("docs/reliability.md",), _both("stops --controller {}"), tall=True),
    "arrive": Table(("docs/reliability.md",), _both("arrive --controller {} --episodes 20"), tall=True),
}


@dataclasses.dataclass(frozen=True)
class Run:
    """One experiment with one controller, as a user would call it."""

    label: str
    words: str
    entry: Entry

    @classmethod
    def of(cls, label: str, words: str, options: argparse.Namespace) -> "Run":
        """Parse the words of `hugwbc evaluate`, at the seed of the options, few and short episodes if quick."""
        if options.policy:
            words += f" --policy {shlex.quote(options.policy)}"
        if options.quick:
            words = re.sub(r" --(episodes|duration) \S+", "", words)
            words += f" {QUICK.get(words.split()[0], '--episodes 1')}"
        words += f" --seed {options.seed}"
        given = words.format(public=shlex.quote(str(options.public)))
        # What stands in a document names no folder of this machine.
        return cls(label, words.format(public="FOLDER"), parse_entry(shlex.split(given))[0])


def can_run(table: Table, options: argparse.Namespace) -> bool:
    """Return whether the networks of other projects that a table needs are given."""
    return bool(options.public) or not any("{public}" in words for words in table.runs.values())


def of_policy(table: Table) -> Table:
    """Return a table with its runs of an H1's learned controller alone."""
    runs = {
        label: words
        for label, words in table.runs.items()
        if "--controller learned" in words and "--robot g1" not in words
    }
    return dataclasses.replace(table, runs=runs)


def cell(figure: Figure | None) -> str:
    """Return value, half of its 95 % interval, and for falls their number; in italics if worse than the paper's.

    Of few samples their number takes the place of the interval, which is too narrow. A search for a force has both ends
    of its bracket, whose lower one is the value, and a median, which is seldom in the middle, those of its interval.
    """
    if figure is None or figure.value is None:
        return ""
    estimate = figure.estimate
    low, high = (None, None) if estimate is None else (estimate.low, estimate.high)
    if estimate is not None and low is not None and high is not None and figure.unit.startswith("% of"):
        count = round(figure.value * estimate.samples / 100.0)
        return f"{count} of {estimate.samples} ({low:.0f} to {high:.0f} %)"
    digits = 0 if abs(figure.value) >= 100.0 else 1 if abs(figure.value) >= 10.0 else 3
    text = f"{figure.value:.{digits}f}"
    if estimate is not None and low is not None and high is not None:
        if figure.table.startswith("Tolerated force"):
            text = f"{low:.3g} to {high:.3g}"
        elif "median" in figure.quantity:
            text += f" ({low:.3g} to {high:.3g})"
        else:
            few = estimate.samples < FEW
            text += f" (n = {estimate.samples})" if few else f" ± {(high - low) / 2.0:.{digits}f}"
    worse = figure.against_paper in (Comparison.WORSE, Comparison.UNCLEAR_WORSE)
    return f"*{text}*" if worse else text


def entry(figure: Figure) -> tuple[str, str]:
    """Return quantity and cell of a figure; reasons of failures, which are figures of their own, share a quantity."""
    quantity, text = figure.quantity, cell(figure)
    if quantity.startswith(f"{FAILED}: "):
        return FAILED, f"{quantity.removeprefix(f'{FAILED}: ')}: {text.partition(' of ')[0]}"
    return quantity, text


def short_titles(figures: Sequence[Figure]) -> dict[str, str]:
    """Return the titles of figures without what all of them begin with; a single one tells nothing and is empty."""
    parts = {figure.table: figure.table.split(", ") for figure in figures}
    shared = sum(1 for _ in itertools.takewhile(lambda each: len(set(each)) == 1, zip(*parts.values(), strict=False)))
    return {title: ", ".join(each[shared:]) for title, each in parts.items()}


def lay_out(table: Table, found: dict[str, list[Figure]]) -> list[list[str]]:
    """Return the cells of a table, its heading first.

    Args:
        table: the table.
        found: the figures of its runs, by label.
    """
    rows: dict[tuple[str, str], dict[str, str]] = {}  # by title of the figures, such as a task, and label
    for label, figures in found.items():
        short = short_titles(figures)
        for figure in figures:
            quantity, text = entry(figure)
            # What only papers have would take the place of what ran: their rows have the same names.
            if figure.estimate is None or (table.quantities and quantity not in table.quantities):
                continue
            known = quantity in (*ERRORS, FALLS, FAILED) or not figure.unit
            name, title = quantity if known else f"{quantity} [{figure.unit}]", short[figure.table]
            if table.tall:
                name, title = ": ".join(filter(None, (title, name))), ""
            if figure.paper is not None:
                kind = (
                    label if ", " in label else "" if figure.reference else figure.table
                )  # ends with gait or arm motion
                paper = ", ".join(filter(None, ("paper", kind.rpartition(", ")[2], figure.reference)))
                rows.setdefault((title if figure.reference else "", paper), {})[name] = f"{figure.paper:.3f}"
            row = rows.setdefault((title, label), {})
            row[name] = f"{row[name]}; {text}" if quantity == FAILED and name in row else text
    order = list(dict.fromkeys(name for row in rows.values() for name in row))
    if table.quantities and not table.tall:
        order.sort(key=lambda name: table.quantities.index(name.partition(" [")[0]))
    titles = list(dict.fromkeys(title for title, _ in rows))
    cells = [["", *order]]
    for key in sorted(rows, key=lambda key: titles.index(key[0])):  # the labels of a title side by side
        cells.append([": ".join(filter(None, key)), *(rows[key].get(name, "") for name in order)])
    return [list(column) for column in zip(*cells, strict=True)] if table.tall else cells


def runs_of(table: Table, options: argparse.Namespace) -> list[Run]:
    """Return the runs of a table, of each label in order."""
    return [Run.of(label, part, options) for label, words in table.runs.items() for part in words.split("; ")]


def markdown(cells: Sequence[Sequence[str]], runs: Sequence[Run]) -> str:
    """Return cells as a table, above the commands that made it."""
    lines = [cells[0], ["---"] * len(cells[0]), *cells[1:]]
    return "\n".join(["| " + " | ".join(line) + " |" for line in lines]) + f"\n\n{commands(runs)}"


def commands(runs: Sequence[Run]) -> str:
    """Return the commands of runs, one for all controllers: `qp|learned`."""
    controllers: dict[str, list[str]] = {}
    for run in runs:
        name = run.entry.spec.name
        others = run.words.replace(f"--controller {name}", "--controller CONTROLLER")
        controllers.setdefault(others, []).append(name)
    return ", ".join(
        f"`hugwbc evaluate {words.replace('CONTROLLER', '|'.join(each))}`" for words, each in controllers.items()
    )


def marked(text: str) -> Iterator[re.Match[str]]:
    """Yield the generated parts of a document: groups `name`, `commit` and `body`."""
    return re.finditer(r"<!-- results: (?P<name>[\w-]+) ?(?P<commit>\S*) -->\n(?P<body>.*?)<!-- end -->", text, re.S)


def replaced(text: str, name: str, body: str, commit: str) -> str:
    """Return a document with another table at its place."""
    for part in marked(text):
        if part["name"] == name:
            generated = f"<!-- results: {name} {commit} -->\n{body}\n<!-- end -->"
            return text[: part.start()] + generated + text[part.end() :]
    raise SystemExit(f"no place for the table {name}: write '<!-- results: {name} -->' and '<!-- end -->'")


def check_policies(tables: dict[str, Table]) -> None:
    """Refuse tables of the ablation whose policies are not there."""
    needed = [policy for policy in ABLATION if any(policy in table.runs for table in tables.values())]
    lacking = [f"{POLICIES}/{policy}" for policy in needed if not (ROOT / POLICIES / policy / POLICY_FILE).is_file()]
    if lacking:
        raise SystemExit(
            f"no {POLICY_FILE} in {', '.join(lacking)}; put the policies there, or choose other tables with --only"
        )


def same_tool(table: Table, commit: str) -> bool:
    """Return whether the file that runs other projects' controllers is that of a commit, if the table needs it."""
    if not any(PUBLIC_CONTROLLERS in words for words in table.runs.values()):
        return True
    line = ["git", "-C", str(ROOT), "diff", "--quiet", commit, "--", PUBLIC_CONTROLLERS]
    return subprocess.run(line, check=False).returncode == 0


def check(tables: dict[str, Table], options: argparse.Namespace) -> int:
    """Print the tables that belong to another commit or to other commands than now, and return 1 if there are any."""
    now, old = short_commit(), []
    for name, table in tables.items():
        # Without the folder of their networks, the commands of other people's are not known.
        made = commands(runs_of(table, options)) if can_run(table, options) else ""
        for document in table.documents:
            parts = {part["name"]: part for part in marked((ROOT / document).read_text())}
            commit, body = parts[name].group("commit", "body") if name in parts else ("", "")
            if commit != now:
                old.append(f"{document}: {name} is of commit {commit or 'unknown'}")
            elif not same_tool(table, commit):
                old.append(f"{document}: {name} is of another {PUBLIC_CONTROLLERS}")
            elif made and not body.endswith(f"\n\n{made}\n"):
                old.append(f"{document}: {name} is of other commands than {made}")
    print("\n".join([*old, f"{len(old)} tables are not of commit {now} and its commands"]))
    return 1 if old else 0


def main() -> int:
    """Run the experiments of all tables that are asked for, and write each as soon as its runs are there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--only", nargs="+", choices=TABLES, default=list(TABLES), metavar="TABLE", help=", ".join(TABLES)
    )
    parser.add_argument("--workers", type=int, default=2, help="processes that share the episodes")
    parser.add_argument("--cluster", help="address of a Dask scheduler whose workers run the episodes instead")
    parser.add_argument(
        "--seed", type=int, help="by default one for reports, or for selection with --quick or --policy"
    )
    parser.add_argument("--quick", action="store_true", help="few, short episodes; print the tables instead of writing")
    parser.add_argument(
        "--check", action="store_true", help="run nothing; fail if a table is of another commit or command"
    )
    parser.add_argument("--public", help="folder with other people's networks, named as PUBLIC and WHOLE_BODY say")
    parser.add_argument("--policy", help="policy of an H1: print the tables with it as the only controller")
    options = parser.parse_args()
    if options.seed is None:  # what is looked at while something is changed is not what is published
        options.seed = SELECTION_SEED if options.quick or options.policy else REPORT_SEED
    if options.check:
        return check({name: TABLES[name] for name in options.only}, options)
    if "+" in short_commit() and not (options.quick or options.policy):
        raise SystemExit(
            f"a table belongs to a commit, but the source is {short_commit()}, changed since; commit or undo the "
            "changes, or only print the tables with --quick"
        )
    tables = {name: TABLES[name] for name in options.only if can_run(TABLES[name], options)}
    if not (options.quick or options.policy or all(same_tool(table, "HEAD") for table in tables.values())):
        raise SystemExit(f"{PUBLIC_CONTROLLERS} is changed; commit or undo the changes, or only print with --quick")
    if left_out := [name for name in options.only if name not in tables]:
        words = f"without --public FOLDER, which holds other projects' networks, {', '.join(left_out)} cannot run"
        if not tables:
            raise SystemExit(words)
        print(words)
    for name, table in tables.items():  # now, and not after hours
        for document in table.documents:
            replaced((ROOT / document).read_text(), name, "", "")
    if options.policy:
        tables = {name: table for name, each in tables.items() if (table := of_policy(each)).runs}
        if not tables:
            raise SystemExit("none of these tables has the learned controller of an H1; choose others with --only")
    check_policies(tables)
    runs = {name: runs_of(table, options) for name, table in tables.items()}
    begin, entries = time.monotonic(), [run.entry for part in runs.values() for run in part]
    with Execution(options.workers, cluster=options.cluster) as execution, progress("results") as advance:
        results = each_result(entries, execution=execution, store=Store(), on_progress=advance, tell=print)
        for name, table in tables.items():
            found: dict[str, list[Figure]] = {}
            for run in runs[name]:
                found.setdefault(run.label, []).extend(next(results).figures)
            body = markdown(lay_out(table, found), runs[name])
            for document in table.documents:
                if options.quick or options.policy:
                    print(f"\n{document}: {name}\n\n{body}", flush=True)
                else:
                    path = ROOT / document
                    write_whole(path, replaced(path.read_text(), name, body, short_commit()))
    print(f"{len(tables)} tables at commit {short_commit()} in {(time.monotonic() - begin) / 3600.0:.2f} hours")
    return 0


if __name__ == "__main__":
    sys.exit(main())
