"""`hugwbc scripts`: list the shipped scripts, or print one as a start for one's own."""

import dataclasses
from collections.abc import Sequence

import tyro

from hugwbc.cli.output import parse, say
from hugwbc.errors import UnknownNameError
from hugwbc.scripts.behaviours import behaviour_file
from hugwbc.scripts.script_file import FOLDER, SCRIPT_NAMES, load_script


@dataclasses.dataclass(frozen=True)
class ScriptsOptions:
    """List the shipped scripts and behaviours, or print one of them, to copy and change.

    `hugwbc play --script NAME` and `hugwbc compare --script NAME` play one. A behaviour ends by what happens, and its
    description says which scene it needs. How to write one say `hugwbc docs add-a-command-script` and
    `hugwbc docs add-a-behaviour`. `hugwbc tasks` lists the tasks.
    """

    name: tyro.conf.Positional[str | None] = None
    """Script to print as YAML; without one, all are listed."""


def run(words: Sequence[str]) -> int:
    """Parse, then list or print."""
    name = parse(ScriptsOptions, words, "scripts", ScriptsOptions.__doc__).name
    files = {each: FOLDER / f"{each}.yaml" for each in SCRIPT_NAMES}
    files |= {each: behaviour_file.FOLDER / f"{each}.yaml" for each in behaviour_file.BEHAVIOUR_NAMES}
    if name is not None:
        if name not in files:
            raise UnknownNameError("script", name, tuple(files))
        say(files[name].read_text(encoding="utf-8").rstrip())
        return 0
    width = max(map(len, files))
    for each in SCRIPT_NAMES:
        script = load_script(each)
        say(f"{each:<{width}}  {script.duration:7.1f} s  {script.about}")
    for each in behaviour_file.BEHAVIOUR_NAMES:
        say(f"{each:<{width}}  as needed  {behaviour_file.load_behaviour(each).about}")
    say("\n`hugwbc play --script NAME` plays one, `hugwbc scripts NAME` prints it.")
    return 0
