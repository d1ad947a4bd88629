"""Read the blocks of a page, and do what the page says."""

import contextlib
import dataclasses
import io
import os
import pathlib
import re
import shlex
import subprocess
import sys

from hugwbc.cli import main

ROOT = pathlib.Path(__file__).parents[2]
_BLOCK = re.compile(
    r"(?:<!-- (?P<mark>[^\n]*) -->\n)?"
    r'^```(?P<language>\w*)(?: title="(?P<title>[^"]+)")?\n(?P<text>.*?)^```$',
    flags=re.DOTALL | re.MULTILINE,
)
# A short training ends with an evaluation that takes longer than all its steps: the tests make do with less.
SHORT_EVALUATION = ["--evaluation-robots", "4", "--evaluation-seconds", "0.1"]
_NUMBER = re.compile(r"-?\d+(\.\d+)?(e-?\d+)?")


@dataclasses.dataclass(frozen=True)
class Block:
    """A fenced block of a page: `title` is the file that it gives, `mark` the comment above it, for the tests."""

    language: str
    text: str
    title: str | None
    mark: str
    line: int


def blocks(page: pathlib.Path) -> list[Block]:
    """Return the blocks of a page, in order."""
    text = page.read_text()
    found = [
        Block(m["language"], m["text"], m["title"], m["mark"] or "", text[: m.start("language")].count("\n") + 1)
        for m in _BLOCK.finditer(text)
    ]
    assert len(found) * 2 == len(re.findall(r"^```", text, flags=re.MULTILINE)), (
        f"{page}: a fence is not closed, or says something unknown"
    )
    return found


def shape_of(text: str) -> str:
    """Return a text without its numbers: what a page shows has to agree with what is printed but for those."""
    return _NUMBER.sub("#", text.strip())


def follow(
    page: pathlib.Path,
    folder: pathlib.Path,
    package: pathlib.Path = ROOT,
    *,
    slow: bool = False,
    in_processes: bool = False,
) -> None:
    """Do what a page says, in a folder: write its files, apply its patches, run its programs and commands.

    `package` is the folder with the `hugwbc` to run; another one than ours runs in processes of its own.
    """
    printed = ""
    for block in blocks(page):
        where = f"{page.name}:{block.line}"
        if block.mark.startswith("not run by the tests: ") or (block.mark == "slow" and not slow):
            continue
        if block.language == "diff":
            apply(block.text, package, where)
        elif block.title is not None:
            path = (package if block.title.startswith("hugwbc/") else folder) / block.title
            assert package != ROOT or not path.is_relative_to(ROOT), where
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text)
        elif block.language == "python":
            printed = _run([sys.executable, "-c", block.text], folder, package, where)
        elif block.language == "sh":
            for line in block.text.replace("\\\n", " ").splitlines():
                words = shlex.split(line, comments=True)
                if words[:2] == ["hugwbc", "train"] and "--recipe" not in words:
                    words += SHORT_EVALUATION
                if words:
                    # A training of several processes takes the place of the one that starts it.
                    apart = in_processes or "--processes" in words
                    here = words[0] == "hugwbc" and package == ROOT and not apart
                    printed = (_verb if here else _command)(words, folder, package, where)
        elif block.language == "text":
            assert shape_of(printed) == shape_of(block.text), f"{where}: {printed}"


def apply(patch: str, package: pathlib.Path, where: str) -> None:
    """Apply a unified diff without line numbers: each hunk has to fit in exactly one place."""
    for part in re.split(r"^--- .*\n", patch, flags=re.MULTILINE)[1:]:
        head, _, hunks = part.partition("\n")
        path = package / head.removeprefix("+++ ").strip()
        text = path.read_text() if path.exists() else ""
        for hunk in re.split(r"^@@.*\n", hunks, flags=re.MULTILINE)[1:]:
            lines = [line or " " for line in hunk.splitlines()]
            old = "".join(line[1:] + "\n" for line in lines if line[0] in " -")
            new = "".join(line[1:] + "\n" for line in lines if line[0] in " +")
            assert text.count(old) == 1, f"{where}: fits {text.count(old)} times into {path.name}:\n{old}"
            text = text.replace(old, new)
        path.write_text(text)


def _verb(words: list[str], folder: pathlib.Path, package: pathlib.Path, where: str) -> str:
    """Run `hugwbc` in this process, which has loaded it already."""
    output = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(output):
        assert main(words[1:]) == 0, f"{where}: {shlex.join(words)}"
    return output.getvalue()


def _command(words: list[str], folder: pathlib.Path, package: pathlib.Path, where: str) -> str:
    program, *rest = words
    if program == "hugwbc":
        return _run([sys.executable, "-m", "hugwbc.cli", *rest], folder, package, where)
    if program == "python":
        return _run([sys.executable, *rest], folder, package, where)
    if program == "pip":
        # No network, and nothing into the environment that the tests run in.
        private = ["--no-index", "--no-deps", "--no-build-isolation", "--quiet", "--target", str(folder / "site")]
        return _run([sys.executable, "-m", "pip", *rest, *private], folder, package, where)
    raise AssertionError(f"{where}: the tests do not know how to run {program}")


def _run(words: list[str], folder: pathlib.Path, package: pathlib.Path, where: str) -> str:
    path = os.pathsep.join([str(package), str(folder / "site"), str(folder)])
    result = subprocess.run(
        words,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=600,
        env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
        check=False,
    )
    assert result.returncode == 0, f"{where}:\n{result.stdout}{result.stderr}"
    return result.stdout
