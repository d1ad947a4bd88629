"""Deploy each controller to the simulated robot in real time, five jobs of five minutes, and print a table.

    python tools/deployments.py [--controllers qp learned] [--jobs stand walk] [--minutes 5] [--out out/deployments]

Each job runs over loopback DDS once as it is, and once with 1 % of the packets lost and up to 5 ms of jitter. Nothing
else should run on the machine. What both programs print is kept in files; a run of the same code, controller and length
whose files are complete is not repeated, so that after a kill the same command goes on.
"""

import argparse
import pathlib
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence

import yaml

from hugwbc.evaluation.store import controller_digest
from hugwbc.files import digest, digest_of, write_whole
from hugwbc.learned.policy.records import versions
from hugwbc.runtime.controllers import ControllerSpec
from hugwbc.settings import REPORT_SEED
from hugwbc.source import source_commit

JOBS = ("stand", "walk", "turn", "squat", "task")
RADIOS = {"clean": (), "lossy": ("--loss", "0.01", "--jitter", "0.005")}
TASK = "deliver_box"
BEGIN = "0.5 Start, 1.5 lower, 6.5 A, 7 release"  # of the remote control and the hoist
FIRST, MARGIN = 9.0, 15.0  # [s] when the sticks move first; by which the robot outlives the deployment
STICKS = {"walk": ("ly=0.5", "ly=0", "ly=-0.5", "ly=0"), "turn": ("rx=0.5", "rx=0", "rx=-0.5", "rx=0")}
STICK = 10.0  # [s] from one position of a stick to the next
SQUATS = ({"h": -0.2}, {}, {"h": -0.1, "p": 0.3}, {}, {"h": -0.25, "w": 0.5}, {})
SQUAT = 4.0  # [s] of each posture
ENDED, DONE = "run -> damping: asked to stop", f"{TASK}: done"  # of a run without a fault; of the task's judge
FAULT = "ended by a watchdog or another fault\n"
ENDED_BY_A_FAULT = 1  # what `hugwbc deploy` then exits with
LATENCY = re.compile(r"latency from state to command: median ([\d.]+) ms, 99.9 % ([\d.]+) ms, largest ([\d.]+) ms")
LATE = re.compile(r"left out: (\d+) of (\d+), at most (\d+) in a row")


def schedule(job: str, seconds: float) -> str:
    """Return what the remote control does in a job."""
    if job not in STICKS:
        return BEGIN
    positions, count = STICKS[job], int((seconds - FIRST) / STICK)
    return ", ".join((BEGIN, *(f"{FIRST + STICK * i:g} {positions[i % len(positions)]}" for i in range(count))))


def options(job: str, seconds: float, folder: pathlib.Path) -> tuple[Sequence[str], Sequence[str]]:
    """Return the options of a job for the robot and for the deployment; a script is written into the folder."""
    if job == "task":
        words = ("--task", TASK, "--seed", str(REPORT_SEED))
        return words, words
    if job == "squat":
        count = max(int((seconds - FIRST) / SQUAT), 1)
        segments = [
            {"label": "posture", "duration": SQUAT, "commands": SQUATS[i % len(SQUATS)], "ramp": SQUAT / 2}
            for i in range(count)
        ]
        path = folder / "squats.yaml"
        path.write_text(yaml.safe_dump({"about": "Squats.", "segments": segments}))
        return (), ("--script", str(path))
    return (), ()


def deploy(controller: str, job: str, radio: str, seconds: float, folder: pathlib.Path) -> tuple[str, str]:
    """Run both programs; return what the robot and the deployment printed."""
    code = source_commit(policies=False), digest_of(__file__), versions()
    made = digest(f"{code} {controller_digest(ControllerSpec(controller))} {seconds}")[:8]
    stem = f"{pathlib.Path(controller).name}-{job}-{radio}-{made}"
    files = [folder / f"{stem}-{side}.txt" for side in ("robot", "deploy")]
    if not all(path.exists() for path in files):
        of_robot, of_deployment = options(job, seconds, folder)
        robot = ["simulate-robot", "--schedule", schedule(job, seconds), "--duration", f"{seconds + MARGIN:g}"]
        words = (
            [*robot, *RADIOS[radio], *of_robot],
            ["deploy", "--controller", controller, "--duration", f"{seconds:g}", *of_deployment],
        )
        running, printed = [], []
        for name, each in zip(("robot", "deploy"), words, strict=True):
            printed.append(folder / f"{stem}-{name}.partial")  # a pipe that nobody empties would hold them up
            with printed[-1].open("w") as file:
                line = [sys.executable, "-m", "hugwbc.cli", *each]
                running.append(subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=file, stderr=file))
        try:
            for process in running:
                process.wait(timeout=3.0 * seconds + 60.0)
            texts = [path.read_text() for path in printed]
            crashed = running[1].returncode not in (0, ENDED_BY_A_FAULT) or "Traceback" in texts[1]
            if running[0].returncode or crashed:
                raise SystemExit(f"{stem} did not run:\n" + "\n".join(texts))
            texts[1] += FAULT if running[1].returncode else ""
        except subprocess.TimeoutExpired:
            raise SystemExit("\n".join([f"{stem} did not end:", *(path.read_text() for path in printed)])) from None
        finally:
            for process, path in zip(running, printed, strict=True):
                process.kill()
                path.unlink()
        for path, text in zip(files, texts, strict=True):
            write_whole(path, text)
    robot_text, deploy_text = (path.read_text() for path in files)
    return robot_text, deploy_text


def row(name: str, runs: Sequence[tuple[str, str]]) -> str:
    """Return a row of the table for the runs of a controller under a radio."""
    whole, done = sum(ENDED in text and FAULT not in text for _, text in runs), sum(DONE in text for text, _ in runs)
    latency = [tuple(map(float, found.groups())) for _, text in runs if (found := LATENCY.search(text))]
    late = [tuple(map(int, found.groups())) for _, text in runs if (found := LATE.search(text))]
    if not latency or not late:
        return f"| {name} | {whole} of {len(runs)} | {done} | | |"
    median, p999 = (statistics.median(values) for values in list(zip(*latency, strict=True))[:2])
    largest, most = max(one[2] for one in latency), max(one[2] for one in late)
    share = 100.0 * sum(one[0] for one in late) / max(sum(one[1] for one in late), 1)
    figures = f"{median:.1f}, {p999:.0f}, {largest:.0f} | {share:.1f} %, {most}"
    return f"| {name} | {whole} of {len(runs)} | {done} | {figures} |"


def main() -> None:
    """Run the deployments that are missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--controllers", nargs="+", default=["learned", "qp"])
    parser.add_argument("--jobs", nargs="+", choices=JOBS, default=JOBS)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out/deployments"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for controller in given.controllers:
        for radio in RADIOS:
            runs = []
            for job in given.jobs:
                begin = time.monotonic()
                runs.append(deploy(controller, job, radio, 60.0 * given.minutes, given.out))
                print(f"{controller}, {job}, {radio}: {time.monotonic() - begin:.0f} s", flush=True)
                print("\n".join(runs[-1]), flush=True)
            rows.append(row(f"{controller}, {radio}", runs))
    latency, late = "latency, median, 99.9 %, largest [ms]", "periods late or left out, most in a row"
    print(f"| | runs to the end | task done | {latency} | {late} |\n|---|---|---|---|---|")
    print("\n".join(rows))


if __name__ == "__main__":
    main()
