"""The command line: `hugwbc VERB`, one file per verb, each loaded only when it is asked for."""

import importlib
import itertools
import sys
import types
from collections.abc import Sequence

from hugwbc.errors import HugwbcError, UnknownNameError

VERBS = {
    "report": "run all protocols with each controller and write every table and figure",
    "compare": "play one script with each controller and report how they did",
    "evaluate": "run one of the paper's protocols and print the errors beside the paper's",
    "play": "watch a controller live in the browser",
    "imitate": "give a training its start: a policy that imitates qp",
    "distil": "fit one policy to several, each the teacher of a gait",
    "train": "train a policy, or continue a training",
    "export": "write a policy as an ONNX file",
    "motions": "write a library of arm motions, made by the hand IK",
    "check": "verify the installation: models, versions, a rollout",
    "bench": "measure speed: training environment, controllers, IK",
}
USAGE_ERROR = 2
INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb.

    Args:
        argv: the words after `hugwbc`; None for those of this process.

    Returns:
        The exit code: 0 for success, 1 for a failed check, 2 for bad input, 130 after Ctrl-C.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    if not words or words[0] in ("-h", "--help"):
        print(_usage())
        return 0 if words else USAGE_ERROR
    if words[0] == "--version":
        import hugwbc

        print(f"hugwbc {hugwbc.__version__}")
        return 0
    try:
        if words[0] not in VERBS:
            raise UnknownNameError("verb", words[0], VERBS)
        return _verb(words[0]).run(_with_json_path(words[1:]))
    except HugwbcError as error:
        print(f"hugwbc: {error}", file=sys.stderr)
        return USAGE_ERROR
    except KeyboardInterrupt:
        print("hugwbc: stopped", file=sys.stderr)
        return INTERRUPTED


def _usage() -> str:
    width = max(map(len, VERBS))
    lines = [f"  {verb:<{width}}  {what}" for verb, what in VERBS.items()]
    return "\n".join(["usage: hugwbc VERB [OPTIONS]", "", *lines, "", "`hugwbc VERB --help` lists a verb's options."])


def _verb(name: str) -> types.ModuleType:
    return importlib.import_module(f"hugwbc.cli.{name}")


def _with_json_path(words: list[str]) -> list[str]:
    """`--json` without a path means standard output, as `--json -`."""
    result: list[str] = []
    for word, following in itertools.zip_longest(words, words[1:], fillvalue="--"):
        result.append(word)
        if word == "--json" and following.startswith("--"):
            result.append("-")
    return result
