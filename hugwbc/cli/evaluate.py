"""`hugwbc evaluate PROTOCOL`: one protocol with one controller; each protocol is a subcommand with its own options."""

import contextlib
import dataclasses
import inspect
import pathlib
import re
import sys
import typing
from collections.abc import Iterator, Sequence
from typing import Annotated, Any

import tyro

from hugwbc.cli.output import check_writable, output_folder, parse, progress, say, write_json
from hugwbc.errors import ConfigError, HugwbcError, UnknownNameError
from hugwbc.evaluation.conditions import Conditions
from hugwbc.evaluation.engine import DEFAULT_FOLDER, Execution, ResultStore
from hugwbc.evaluation.protocols import PROTOCOLS, Protocol, protocol_names, protocol_of
from hugwbc.evaluation.protocols.episodes import GaitSettings
from hugwbc.gait import Gait
from hugwbc.runtime.controllers import ControllerSpec

DEFAULT = "single-command"
BOTH_LEGS = "hopping"
_GAITS = f"{', '.join(gait.label for gait in Gait)}, or {BOTH_LEGS}, which hops on the left and the right leg in turn"
# Help for options whose field's docstring is written for readers of the code.
_HELP = {
    "gait": f"Gait: {_GAITS}.",
    "intervention": "What moves the arms: none, noise (uniform targets every 1.8 s) or motion (motion files).",
    "motions": "Folder of motion files (.npz) that move the arms; without one, motions are generated.",
}
AnyProtocol = Protocol[Any, Any, Any]


@dataclasses.dataclass(frozen=True)
class ControllerOptions:
    """Which controller is evaluated.

    Attributes:
        controller: name of the controller: learned, qp, hold (a baseline that only holds its pose) or a plug-in;
            FILE.py:NAME; or the path of a policy, or of a contract for somebody else's policy (docs/evaluation.md).
        policy: name of a shipped policy or path of a policy for the learned controller; path of a network for
            somebody else's policy.
    """

    controller: str = "learned"
    policy: str | None = None


@dataclasses.dataclass(frozen=True)
class ExecutionOptions:
    """Where episodes run and where their results are stored.

    Attributes:
        workers: number of processes that share the episodes.
        cluster: address of a Dask scheduler, such as tcp://127.0.0.1:8786, whose workers run the episodes instead.
        results: folder in which finished episodes are stored; those already stored are not run again. None stores none.
        fresh: run all episodes again; the files of earlier results are kept under other names.
    """

    workers: int = 1
    cluster: str | None = None
    results: pathlib.Path | None = DEFAULT_FOLDER
    fresh: bool = False


@dataclasses.dataclass(frozen=True)
class OutputOptions:
    """Where the result goes, apart from the terminal.

    Attributes:
        json: file to write the result to; without a path, it goes to standard output.
    """

    json: pathlib.Path | None = None


@dataclasses.dataclass(frozen=True)
class _Option:
    """An option of the command line, from a field of a dataclass.

    Attributes:
        name: name of the field.
        type: type of its value.
        default: its value if it is not given.
        help: what it means, a sentence.
    """

    name: str
    type: Any
    default: Any
    help: str

    @property
    def field(self) -> tuple[str, Any, Any]:
        """The option as a field for `dataclasses.make_dataclass`."""
        return (
            self.name,
            Annotated[self.type, tyro.conf.arg(help=self.help)],
            dataclasses.field(default=self.default),
        )


def run(words: Sequence[str]) -> int:
    """Parse, run the protocol, print and write its result."""
    protocol, words = _protocol(words)
    options = _parse(protocol, words)
    spec = ControllerSpec(options["controller"], options["policy"])
    execution = _execution(protocol, options)
    settings = protocol.for_training(_settings(protocol, options, execution), spec.training)
    results = contextlib.nullcontext() if execution.store is None else output_folder(options["results"])
    check_writable(options["json"])
    total = protocol.total(settings)
    with results, progress(f"{options['controller']}, {protocol.name}: {total} episodes") as advance, execution:
        done = 0

        def on_episode(_: object) -> None:
            nonlocal done
            done += 1
            read = 0 if execution.store is None else execution.store.restored
            advance(*(min(count / total, 1.0) for count in (done, min(done, read))))

        told = spec.told(settings.conditions.told_arena)
        result = protocol.run(told.build, settings, on_episode)
    say(protocol.describe(result), options["json"])
    content = dataclasses.asdict(result)
    rows = content.pop("rows")
    write_json(options["json"], {**content, "rows": rows})  # the summary before what may be thousands of lines
    return 0


def _protocol(words: Sequence[str]) -> tuple[AnyProtocol, list[str]]:
    """Return the protocol that the words name, and the remaining words.

    Raises:
        SystemExit: after printing the list of protocols, if that is what was asked for.
    """
    words = list(words)
    if words and not words[0].startswith("-"):
        return protocol_of(words[0]), words[1:]
    formerly = next((i for i, word in enumerate(words) if word.partition("=")[0] == "--protocol"), None)
    if formerly is not None:
        return _formerly_named(words, formerly)
    if {"-h", "--help"} & set(words):
        print(_usage())
        raise SystemExit(0)
    return PROTOCOLS[DEFAULT], words


def _formerly_named(words: list[str], index: int) -> tuple[AnyProtocol, list[str]]:
    """Read the former form `--protocol NAME`, which is kept for one release."""
    _, equals, name = words[index].partition("=")
    if not equals and index + 1 == len(words):
        raise ConfigError(
            f"--protocol has no name; give the name as the first word. Valid: {', '.join(protocol_names())}"
        )
    protocol = protocol_of(name if equals else words[index + 1])
    rest = words[:index] + words[index + (1 if equals else 2) :]
    if not protocol.stores_episodes and "--results" in rest:  # was accepted, and ignored
        start = rest.index("--results")
        del rest[start : start + 2]
    print(
        f"hugwbc: `--protocol {protocol.name}` will be removed; write `hugwbc evaluate {protocol.name} ...`",
        file=sys.stderr,
    )
    return protocol, rest


def _usage() -> str:
    width = max(map(len, protocol_names()))
    lines = [f"  {name:<{width}}  {_summary(name)}" for name in protocol_names()]
    return "\n".join(
        [
            "usage: hugwbc evaluate PROTOCOL [OPTIONS]",
            "",
            "Run a protocol with one controller, and print its figures together with the paper's.",
            "",
            *lines,
            "",
            f"`hugwbc evaluate PROTOCOL --help` lists the options of a protocol. Without PROTOCOL, {DEFAULT} runs.",
        ]
    )


def _summary(name: str) -> str:
    """Return a protocol's line of the list; one of another package that does not work must not hide the others."""
    try:
        return protocol_of(name).summary
    except HugwbcError as error:
        return f"not usable: {error}"


def _parse(protocol: AnyProtocol, words: Sequence[str]) -> dict[str, Any]:
    """Return the values of all options of a protocol, by name."""
    options = list(_options(protocol))
    _refuse_foreign(protocol, words, {option.name for option in options})
    parser = dataclasses.make_dataclass("Options", [option.field for option in options], frozen=True)
    parsed = parse(parser, words, f"evaluate {protocol.name}", _sentence(protocol.summary))
    return {option.name: getattr(parsed, option.name) for option in options}


def _options(protocol: AnyProtocol) -> Iterator[_Option]:
    """Yield the options of a protocol in the order of its help: its own before those that all have."""
    yield from _from_fields(ControllerOptions)
    options = {option.name: option for option in _from_fields(protocol.settings)}
    gait = options.pop("gait")
    del options["both_legs"]  # part of the option for the gait
    if "gait" not in protocol.fixed:
        yield dataclasses.replace(gait, type=str, default=gait.default.label)
    options = {name: option for name, option in options.items() if name not in protocol.fixed}
    yield from sorted(options.values(), key=lambda option: option.name in _names(GaitSettings))
    yield from (option for option in _from_fields(Conditions) if option.name not in protocol.fixed)
    yield from _from_fields(ExecutionOptions) if protocol.stores_episodes else ()
    yield from _from_fields(OutputOptions)


def _from_fields(cls: type[Any]) -> Iterator[_Option]:
    """Make options of the fields that have a plain default; their docstring entries are the help."""
    types, texts = typing.get_type_hints(cls), _field_texts(cls)
    for field in dataclasses.fields(cls):
        if field.default is not dataclasses.MISSING:
            text = _HELP.get(field.name) or _sentence(texts.get(field.name, "").replace("`", ""))
            yield _Option(field.name, types[field.name], field.default, text)


def _names(cls: type[Any]) -> set[str]:
    return {field.name for field in dataclasses.fields(cls)}


def _field_texts(cls: type[Any]) -> dict[str, str]:
    """Return what the docstrings of a class and its bases say about each attribute."""
    texts: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        _, _, section = inspect.cleandoc(base.__doc__ or "").partition("Attributes:\n")
        for names, text in re.findall(r"^ {4}(\w+(?:, \w+)*): (.*(?:\n {8}.*)*)", section, re.MULTILINE):
            texts |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return texts


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:].rstrip('.')}." if text else ""


def _refuse_foreign(protocol: AnyProtocol, words: Sequence[str], known: set[str]) -> None:
    """Refuse options that only other protocols have; all others that are unknown are left to the parser."""
    foreign = {option.name for other in PROTOCOLS.values() for option in _options(other)} - known
    for word in words:
        name = word.partition("=")[0].removeprefix("--").replace("-", "_")
        if word.startswith("--") and name in foreign:
            own = [f for f in dataclasses.fields(protocol.settings) if f.name not in _names(GaitSettings)]
            takes = ", ".join(f"--{field.name.replace('_', '-')}" for field in own)
            raise ConfigError(
                f"--{name.replace('_', '-')} means nothing to the {protocol.name} protocol; it takes {takes} and what "
                f"`hugwbc evaluate {protocol.name} --help` lists"
            )


def _execution(protocol: AnyProtocol, options: dict[str, Any]) -> Execution:
    if not protocol.stores_episodes:
        return Execution()
    store = None if options["results"] is None else ResultStore(options["results"], fresh=options["fresh"])
    return Execution(options["workers"], cluster=options["cluster"], store=store)


def _settings(protocol: AnyProtocol, options: dict[str, Any], execution: Execution) -> Any:  # noqa: ANN401  each has its own type
    """Build the settings of a protocol from the options."""
    given = {name: value for name, value in options.items() if name in _names(protocol.settings)}
    if "gait" in options:
        both_legs = options["gait"] == BOTH_LEGS
        given |= {"gait": Gait.HOPPING_LEFT if both_legs else _gait(options["gait"]), "both_legs": both_legs}
    conditions = Conditions(**{name: value for name, value in options.items() if name in _names(Conditions)})
    return protocol.settings(**given, conditions=conditions, execution=execution)


def _gait(label: str) -> Gait:
    """Return the gait with a label."""
    try:
        return Gait.parse(label)
    except UnknownNameError:
        raise UnknownNameError("gait", label, [*(gait.label for gait in Gait), BOTH_LEGS]) from None
