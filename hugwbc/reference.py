"""What can be read about hugwbc in a terminal: the documents, and the reference of what the packages export."""

import importlib
import inspect
import pathlib
import re
import sys
import textwrap
import types
import typing
from collections.abc import Callable, Mapping
from typing import Annotated, Any

from hugwbc.errors import ConfigError, UnknownNameError

PACKAGES = (
    "hugwbc",
    "hugwbc.runtime",
    "hugwbc.scripts",
    "hugwbc.behaviours",
    "hugwbc.tasks",
    "hugwbc.tasks.judges",
    "hugwbc.sim",
    "hugwbc.sim.scenes",
    "hugwbc.upper_ik",
    "hugwbc.learned.config",
    "hugwbc.learned.policy",
    "hugwbc.targets",
)
"""What programs import from."""
FURTHER = {
    "Body": "hugwbc.learned.env.readings",
    "CountedSettings": "hugwbc.evaluation.episode",
    "Curriculum": "hugwbc.learned.env.curriculum",
    "Experiment": "hugwbc.evaluation.experiment",
    "Figure": "hugwbc.evaluation.figures",
    "HandWrench": "hugwbc.hand_wrench",
    "Knot": "hugwbc.evaluation.plans",
    "ObservationTerm": "hugwbc.learned.policy.terms",
    "Plan": "hugwbc.evaluation.plans",
    "Schedule": "hugwbc.evaluation.plans",
    "Sensed": "hugwbc.learned.policy.terms",
    "Transition": "hugwbc.learned.env.readings",
}
"""Names of other modules, which functions of a user's own are given or return."""
_UNREAD = ("api", "log")  # documents: a skeleton that the site fills, and diaries
_BOUNDS = {"ge": "from", "gt": "above", "le": "to", "lt": "below"}
_WIDTH = 100  # characters


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
    plain = name.removeprefix("docs/").removesuffix(".md")
    found = plain if plain in names else next((full for full in names if full.split("/")[-1] == plain), None)
    if found is None:
        raise UnknownNameError("document", name, (*names, *besides))
    return (document_folder() / f"{found}.md").read_text(encoding="utf-8")


def document_title(name: str) -> str:
    """Return the title of a document, its first heading."""
    lines = document(name).splitlines()
    return next((line.removeprefix("# ") for line in lines if line.startswith("# ")), name)


class _Words(str):
    """What `help` shows without quotes."""

    __slots__ = ()
    __repr__ = str.__str__


def plain_signature(target: Callable[..., Any]) -> inspect.Signature:
    """Return a signature whose types are words, such as `Metres`, and whose defaults are short."""
    found, aliases = inspect.signature(target), _aliases(target)

    def plain(one: inspect.Parameter) -> inspect.Parameter:
        long = one.default is not one.empty and (callable(one.default) or len(repr(one.default)) > _WIDTH // 2)
        default, kind = (_Words("...") if long else one.default), one.annotation
        return one.replace(default=default, annotation=kind if kind is one.empty else _Words(_type(kind, aliases)))

    parameters = [plain(one) for one in found.parameters.values()]
    return found.replace(parameters=parameters, return_annotation=_Words(_type(found.return_annotation, aliases)))


def exported(package: str) -> tuple[str, ...]:
    """Return the names that programs import from a package: its `__all__`, or what a module defines itself."""
    module = importlib.import_module(package)
    own = [name for name, value in vars(module).items() if getattr(value, "__module__", "") == package]
    return tuple(getattr(module, "__all__", None) or [name for name in own if not name.startswith("_")])


def about(package: str) -> str:
    """Return what a package is, in a line."""
    return _first_line(importlib.import_module(package))


def reference(name: str) -> str | None:
    """Return the entry of an exported name, or the list of what a package exports; None where there is no such name.

    Args:
        name: such as "walk_to", "hugwbc.tasks.Task" or "hugwbc.behaviours"; "api/behaviours", as on the site, too.
    """
    plain = name.removeprefix("docs/").removesuffix(".md")
    if plain.startswith("api/"):
        plain = f"hugwbc.{plain.removeprefix('api/')}".removesuffix(".core")
    if plain in PACKAGES:
        module = importlib.import_module(plain)
        rows = (f"{each:<20} {_first_line(getattr(module, each))}" for each in exported(plain))
        return "\n".join([about(plain), "", *rows])
    room, _, last = plain.rpartition(".")
    entries: dict[int, str] = {}  # a name may be exported twice, or mean two things
    packages = [package for package in PACKAGES if last in exported(package)]
    for package in (*packages, *filter(None, [FURTHER.get(last)])):
        if room in ("", package):
            value = getattr(importlib.import_module(package), last)
            entries.setdefault(id(value), f"from {package} import {last}\n\n{_entry(last, value)}")
    return "\n\n\n".join(entries.values()) or None


def _entry(name: str, value: Any) -> str:  # noqa: ANN401
    if not inspect.isroutine(value) and not inspect.isclass(value):
        return _first_line(value)
    text, aliases = _call(name, value), _aliases(value)
    ranges = (f"{alias}: {_type(kind, {})}" for alias, kind in aliases.items() if re.search(rf"\b{alias}\b", text))
    methods = (
        f"{_call(f'{name}.{each}', method)}\n    {_first_line(method)}"
        for each, method in (vars(value).items() if inspect.isclass(value) else ())
        if not each.startswith("_") and isinstance(method, types.FunctionType | property)
    )
    built = inspect.getdoc(value.__init__) if inspect.isclass(value) else ""
    said = [text, "\n".join(ranges), inspect.getdoc(value), built if "Args:" in (built or "") else "", *methods]
    return "\n\n".join(filter(None, said))


def _call(name: str, value: Any) -> str:  # noqa: ANN401
    """Return a name with its signature."""
    text = name if isinstance(value, property) else f"{name}{plain_signature(value)}".replace("(self, ", "(")
    kept = re.sub("(?<!,) ", "\N{NO-BREAK SPACE}", text)  # lines end behind commas
    return "\n".join(textwrap.wrap(kept, _WIDTH, subsequent_indent="    ")).replace("\N{NO-BREAK SPACE}", " ")


def _first_line(value: object) -> str:
    """Return the first line of a docstring; of a constant or an alias, what it is."""
    if inspect.ismodule(value) or inspect.isroutine(value) or inspect.isclass(value) or isinstance(value, property):
        return (inspect.getdoc(value) or "").partition("\n")[0]
    text = _type(value, {}) if typing.get_origin(value) else repr(value)
    return text if len(text) <= _WIDTH else f"{text[:_WIDTH]}..."


def _aliases(target: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return the types that the modules of a function or class have named."""
    kinds = inspect.getmro(target) if inspect.isclass(target) else [target]
    modules = [sys.modules[kind.__module__] for kind in kinds]
    named = {name: value for module in reversed(modules) for name, value in vars(module).items()}
    return {name: value for name, value in named.items() if typing.get_origin(value) and name[0] != "_"}


def _type(kind: Any, aliases: Mapping[str, Any]) -> str:  # noqa: ANN401
    """Return a type in words: the name of an alias, or its parts with their range."""
    for name, value in aliases.items():
        if value is kind:
            return name
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    words = [_type(part, aliases) for part in parts]
    if origin is Annotated:
        rules = [rule for data in kind.__metadata__ for rule in getattr(data, "metadata", ())]
        bounds = [(word, getattr(rule, name, None)) for rule in rules for name, word in _BOUNDS.items()]
        return " ".join([words[0], *(f"{word} {bound:g}" for word, bound in bounds if bound is not None)])
    if origin in (typing.Union, types.UnionType, typing.Literal):
        return " | ".join(words)
    if isinstance(kind, list | str):  # arguments of a Callable; a choice of a Literal
        return f"[{', '.join(_type(part, aliases) for part in kind)}]" if isinstance(kind, list) else repr(kind)
    name = {type(None): "None", Ellipsis: "..."}.get(kind) or getattr(origin or kind, "__name__", str(kind))
    return f"{name}[{', '.join(words)}]" if parts else name
