"""`hugwbc docs`: list the documents that come with the package, or print one."""

import dataclasses
import sys
from collections.abc import Sequence

import tyro

from hugwbc.cli.output import parse, say
from hugwbc.documents import document, document_names, document_title


@dataclasses.dataclass(frozen=True)
class DocsOptions:
    """List the documents and how-tos that come with the package, or print one of them."""

    name: tyro.conf.Positional[str | None] = None
    """Document to print, such as tasks, how-to/add-a-task or docs/tasks.md; without one, all are listed."""


def run(words: Sequence[str]) -> int:
    """Parse, then list or print: formatted on a terminal, as Markdown elsewhere."""
    name = parse(DocsOptions, words, "docs", DocsOptions.__doc__).name
    if name is None:
        names = document_names()
        width = max(map(len, names))
        for each in names:
            say(f"{each:<{width}}  {document_title(each)}")
        say("\n`hugwbc docs NAME` prints one.")
    elif sys.stdout.isatty():
        from rich.console import Console
        from rich.markdown import Markdown

        Console().print(Markdown(document(name)))
    else:
        say(document(name).rstrip())
    return 0
