"""Errors share a base and name the valid choices."""

import inspect
import pickle

import pytest

from hugwbc import errors

ERRORS = [kind for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, Exception)]


def test_unknown_name_lists_the_valid_and_suggests_a_close_one() -> None:
    message = str(errors.UnknownNameError("gait", "walkin", ["standing", "walking"]))
    assert message == "unknown gait 'walkin'. Did you mean 'walking'? Valid: standing, walking."


def test_unknown_name_without_a_close_one_makes_no_guess() -> None:
    message = str(errors.UnknownNameError("gait", "xyz", iter(["standing", "walking"])))
    assert message == "unknown gait 'xyz'. Valid: standing, walking."


@pytest.mark.parametrize("kind", ERRORS, ids=lambda kind: kind.__name__)
def test_every_error_has_the_common_base_and_comes_back_from_a_worker_process_as_it_was(kind) -> None:
    """Processes send them as pickles; one that cannot be read again looks like a worker that died."""
    error = kind("gait", "walkin", ["walking"]) if issubclass(kind, errors.UnknownNameError) else kind("seed is -1")
    back = pickle.loads(pickle.dumps(error))
    assert isinstance(back, errors.HugwbcError) and type(back) is kind and str(back) == str(error)
