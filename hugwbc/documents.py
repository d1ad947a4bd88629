"""The documents: Markdown pages that come with the package, by name."""

import pathlib

from hugwbc.errors import ConfigError, UnknownNameError

_UNREAD = ("api", "log")  # a skeleton that the site fills, and diaries


def document_folder() -> pathlib.Path:
    """Return the folder of the documents: inside an installed package, or next to it in a source checkout."""
    package = pathlib.Path(__file__).parent
    for candidate in (package / "docs", package.parent / "docs"):
        if (candidate / "getting-started.md").is_file():
            return candidate
    raise ConfigError(f"the documents were found neither in {package} nor next to it; reinstall hugwbc")


def document_names() -> tuple[str, ...]:
    """Return the names of the documents, such as "tasks" and "how-to/add-a-task", sorted, how-tos last."""
    folder = document_folder()
    pages = [path.relative_to(folder).with_suffix("") for path in folder.rglob("*.md")]
    names = [page.as_posix() for page in pages if page.parts[0] not in _UNREAD]
    return tuple(sorted(names, key=lambda name: ("/" in name, name)))


def document(name: str, besides: tuple[str, ...] = ()) -> str:
    """Return a document as Markdown.

    Args:
        name: one of `document_names()`. The last part is enough ("add-a-task"), and a path as other texts write it
            ("docs/tasks.md") is taken as well.
        besides: other names to suggest for an unknown one.
    """
    names = document_names()
    wanted = name.removeprefix("docs/").removesuffix(".md")
    found = wanted if wanted in names else next((full for full in names if full.split("/")[-1] == wanted), None)
    if found is None:
        raise UnknownNameError("document", name, (*names, *besides))
    return (document_folder() / f"{found}.md").read_text(encoding="utf-8")


def document_title(name: str) -> str:
    """Return the title of a document, its first heading."""
    lines = document(name).splitlines()
    return next((line.removeprefix("# ") for line in lines if line.startswith("# ")), name)
