"""`hugwbc docs`: list the documents and scripts that come with the package, or print one."""

import dataclasses
import difflib
import inspect
import pathlib
import sys
from collections.abc import Sequence

import tyro

from hugwbc.cli.output import parse, say
from hugwbc.reference import FURTHER, PACKAGES, about, document, document_names, document_title, exported, reference


@dataclasses.dataclass(frozen=True)
class DocsOptions:
    """List the documents, how-tos, scripts, tasks and packages, or print one, or a name that a package exports."""

    # Document, script or task to print, such as tasks, add-a-task, walk or fetch_box; package or name of the
    # reference, such as hugwbc.behaviours or walk_to. Without one, all but the names are listed
    name: tyro.conf.Positional[str | None] = None


def run(words: Sequence[str]) -> int:
    """Parse, then list or print: formatted on a terminal, as Markdown elsewhere."""
    from hugwbc.behaviours import BEHAVIOUR_NAMES, load_behaviour
    from hugwbc.scripts.script import FOLDER, SCRIPT_NAMES, load_script
    from hugwbc.tasks.task import SCENES, TASK_NAMES, load_task

    name = parse(DocsOptions, words, "docs").name
    scripts = {each: FOLDER / f"{each}.yaml" for each in SCRIPT_NAMES}
    behaviours = {each: inspect.getmodule(load_behaviour(each)) for each in BEHAVIOUR_NAMES}
    scripts |= {each: pathlib.Path(str(module.__file__)) for each, module in behaviours.items() if module is not None}
    tasks = {each: SCENES.parent / f"{each}.py" for each in TASK_NAMES}
    sources = {each: [of[each] for of in (scripts, tasks) if each in of] for each in (*scripts, *tasks)}
    entry = None if name is None or name in document_names() else reference(name)
    if name in sources or entry is not None:  # a step may have the name of a script
        texts = [path.read_text(encoding="utf-8").rstrip() for path in sources.get(str(name), ())]
        say("\n\n\n".join(filter(None, (*texts, entry))))
    elif name is not None:
        names = {*FURTHER, *(each for package in PACKAGES for each in exported(package))} - set(sources)
        _print(document(name, besides=(*sources, *PACKAGES, *difflib.get_close_matches(name, names))))
    else:
        listed = {each: document_title(each) for each in document_names()}
        listed |= {
            each: f"script, {load_script(each).duration:.1f} s: {load_script(each).about}" for each in SCRIPT_NAMES
        }
        listed |= {each: f"behaviour: {module.__doc__}" for each, module in behaviours.items() if module is not None}
        further = [(each, f"task: {load_task(each).about}") for each in TASK_NAMES]  # some have the name of a script
        further += [(each, f"reference: {about(each)}") for each in PACKAGES]
        width = max(map(len, listed))
        for each, words in (*listed.items(), *further):
            say(f"{each:<{width}}  {words}")
        say("\n`hugwbc docs NAME` prints one, `hugwbc docs walk_to` a name that a package exports;")
        say("`hugwbc play --script NAME` plays a script.")
    return 0


def _print(text: str) -> None:
    if not sys.stdout.isatty():
        say(text.rstrip())
        return
    from rich.console import Console
    from rich.markdown import Markdown

    Console().print(Markdown(text))
