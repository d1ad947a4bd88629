"""The command line: `hugwbc VERB`. Every verb is a file, which is loaded only when the verb is used."""

import contextlib
import importlib
import itertools
import os
import select
import signal
import sys
import threading
import types
from collections.abc import Iterator, Sequence

from hugwbc.errors import HugwbcError, UnknownNameError

VERBS = {
    "report": "run the paper's experiments and some of ours with each controller, and write tables and figures",
    "compare": "play a script or a task, or run an experiment, with each controller, and compare the results",
    "evaluate": "run one of the experiments and print its figures next to the paper's",
    "tasks": "list the tasks of loco-manipulation, or record or replay demonstrations of them",
    "play": "drive a robot from the browser, or watch a command, script, task or motion",
    "docs": "list the documents, scripts and tasks that come with the package, or print one, or a name of the API",
    "deploy": "control a robot over the network, a real or a simulated one",
    "simulate-robot": "simulate a robot behind the messages of a real one",
    "train": "train a policy, or continue a training",
    "export": "write a policy as an ONNX file",
    "check": "verify the installation, the table of a robot, or how a policy was made",
    "bench": "measure the speed of training, controllers, hand IK and whole episodes",
}
_HINTS = ("`hugwbc VERB --help` lists a verb's options.", "`hugwbc --version` says which version this is.")
USAGE_ERROR = 2
INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb, given the words after `hugwbc`, by default those of this process; return the exit code.

    It is 0 for success, 1 where a check, a task, a replay or a deployment failed, 2 for bad input, 130 after Ctrl-C,
    SIGTERM or SIGHUP.
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
        with _terminated_like_ctrl_c():
            return _verb(words[0]).run(_with_json_path(words[1:]))
    except HugwbcError as error:
        print(f"hugwbc: {error}", file=sys.stderr)
        return USAGE_ERROR
    except ModuleNotFoundError as error:
        if error.name not in ("torch", "safetensors"):
            raise
        print(
            f"hugwbc: `hugwbc {words[0]}` needs {error.name}, which is not installed; "
            "run `pip install 'hugwbc[learned]'`",
            file=sys.stderr,
        )
        return USAGE_ERROR
    except RuntimeError as error:
        if "MUJOCO_GL" not in str(error):
            raise
        # MuJoCo says so while it is imported, before a verb could ask.
        print(f"hugwbc: {error}; valid: egl, osmesa or glfw, or leave it unset", file=sys.stderr)
        return USAGE_ERROR
    except KeyboardInterrupt:
        print("hugwbc: stopped", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        if _is_read(sys.stdout.fileno()):
            raise
        # What is left in the buffer would make Python complain when it flushes it at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


@contextlib.contextmanager
def _terminated_like_ctrl_c() -> Iterator[None]:
    """Let SIGTERM, which schedulers and shells send, and SIGHUP of a lost terminal do what Ctrl-C does.

    A program that is started to outlive its terminal (`nohup`) goes on.
    """
    if threading.current_thread() is not threading.main_thread():  # where Python handles no signals
        yield
        return
    ending = [one for one in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(one) is not signal.SIG_IGN]
    before = {one: signal.signal(one, signal.default_int_handler) for one in ending}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


def _is_read(pipe: int) -> bool:
    """Return whether the pipe still has a reader (`hugwbc evaluate --help | head` closes it)."""
    poll = select.poll()
    poll.register(pipe, select.POLLOUT)
    return not any(event & select.POLLERR for _, event in poll.poll(0))


def _usage() -> str:
    width = max(map(len, VERBS))
    lines = [f"  {verb:<{width}}  {what}" for verb, what in VERBS.items()]
    return "\n".join(["usage: hugwbc VERB [OPTIONS]", "", *lines, "", *_HINTS])


def _verb(name: str) -> types.ModuleType:
    return importlib.import_module(f"hugwbc.cli.{name.replace('-', '_')}")


def _with_json_path(words: list[str]) -> list[str]:
    """Expand `--json` without a path to `--json -`, which means standard output."""
    result: list[str] = []
    for word, following in itertools.zip_longest(words, words[1:], fillvalue="--"):
        result.append(word)
        if word == "--json" and following.startswith("--"):
            result.append("-")
    return result
