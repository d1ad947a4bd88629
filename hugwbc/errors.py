"""Errors that a user can act on: each message says what was wrong, what is valid, and what to do."""

import contextlib
import difflib
from collections.abc import Iterable, Iterator

_LONGEST_NAME = 60  # characters; looking for names similar to a longer one takes long


class HugwbcError(Exception):
    """Base of every error that hugwbc raises on bad input; the command line prints it and exits with code 2.

    Attributes:
        at: names and indices that lead from the settings being checked to the wrong one; a file's line is found by it.
    """

    def __init__(self, message: object = "", *, at: tuple[str | int, ...] = ()) -> None:
        super().__init__(message)
        self.at = at


class UnknownNameError(HugwbcError):
    """A name that does not exist, such as one of a joint, gait, command, script, controller or policy."""

    def __init__(self, kind: str, name: object, valid: Iterable[str], *, at: tuple[str | int, ...] = ()) -> None:
        names, name = list(valid), name if len(str(name)) <= _LONGEST_NAME else f"{str(name)[:_LONGEST_NAME]}..."
        close = difflib.get_close_matches(str(name), names, n=1)
        hint = f" Did you mean '{close[0]}'?" if close else ""
        super().__init__(f"unknown {kind} '{name}'.{hint} Valid: {', '.join(names) or 'none'}.", at=at)
        self._made_of = (kind, name, tuple(names))

    def __reduce__(self) -> tuple[type["UnknownNameError"], tuple[str, object, tuple[str, ...]]]:
        """Pickle the constructor arguments; exceptions otherwise keep only the message."""
        return type(self), self._made_of


class UnknownObjectError(UnknownNameError, KeyError):
    """A name that a mapping of objects does not hold; as a KeyError, so that `get` gives its default."""

    __str__ = HugwbcError.__str__  # a KeyError would print the message in quotes


class CommandError(HugwbcError):
    """A command that is no finite number, or lies outside the range of its gait."""


class TargetError(HugwbcError):
    """A target, path or force of the hands or arms that is malformed, out of range, or that an arm cannot follow."""


class PolicyFileError(HugwbcError):
    """A policy or checkpoint file that is truncated, corrupted, foreign or of another version."""


class RecipeError(HugwbcError):
    """A recipe that cannot be read or is not valid, or a run of one that cannot continue."""


class ModelError(HugwbcError):
    """A robot description that is missing or inconsistent."""


class ConfigError(HugwbcError):
    """A setting outside its valid range, or a file that does not hold what it should."""


class SceneError(HugwbcError):
    """A scene that cannot be built, or a scene file that is not valid; names file and line where there is one."""


class CaptureError(HugwbcError):
    """A malformed message of motion capture or for the grippers."""


class DeploymentError(HugwbcError):
    """A robot that cannot be reached, or refuses control."""


@contextlib.contextmanager
def needing(extra: str, what: str) -> Iterator[None]:
    """Turn a failed import into a `ConfigError` that names the extra to install; `what` is its subject."""
    try:
        yield
    except ImportError as error:
        raise ConfigError(f"{what} needs {error.name} ({error}); run `pip install 'hugwbc[{extra}]'`") from error


def one_line(text: str, longest: int = 1000) -> str:
    """Return the beginning of a text on one line that a terminal can show."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text[:longest])
