"""`hugwbc scripts`: list the shipped scripts, or print one as a start for one's own."""

import dataclasses
from collections.abc import Sequence

import tyro

from hugwbc.cli.output import parse, say
from hugwbc.errors import UnknownNameError
from hugwbc.scripts.script_file import FOLDER, SCRIPT_NAMES, load_script


@dataclasses.dataclass(frozen=True)
class ScriptsOptions:
    """List the shipped scripts, or print one of them, to copy and change.

    `hugwbc play --script NAME` and `hugwbc compare --script NAME` play one. How to write one says
    `hugwbc docs add-a-command-script`. `hugwbc tasks` lists the tasks.
    """

    name: tyro.conf.Positional[str | None] = None
    """Script to print as YAML; without one, all are listed."""


def run(words: Sequence[str]) -> int:
    """Parse, then list or print."""
    name = parse(ScriptsOptions, words, "scripts", ScriptsOptions.__doc__).name
    if name is not None:
        if name not in SCRIPT_NAMES:
            raise UnknownNameError("script", name, SCRIPT_NAMES)
        say((FOLDER / f"{name}.yaml").read_text(encoding="utf-8").rstrip())
        return 0
    width = max(map(len, SCRIPT_NAMES))
    for each in SCRIPT_NAMES:
        script = load_script(each)
        say(f"{each:<{width}}  {script.duration:5.1f} s  {script.about}")
    say("\n`hugwbc play --script NAME` plays one, `hugwbc scripts NAME` prints it.")
    return 0
