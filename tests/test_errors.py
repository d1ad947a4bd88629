"""Errors share a base and name the valid choices."""

import inspect
import pickle

from hugwbc import errors


def test_every_error_has_the_common_base() -> None:
    classes = [c for _, c in inspect.getmembers(errors, inspect.isclass) if issubclass(c, Exception)]
    assert len(classes) >= 6
    assert all(issubclass(c, errors.HugwbcError) for c in classes)


def test_unknown_name_lists_the_valid_and_suggests_a_close_one() -> None:
    message = str(errors.UnknownNameError("gait", "walkin", ["standing", "walking"]))
    assert message == "unknown gait 'walkin'. Did you mean 'walking'? Valid: standing, walking."


def test_unknown_name_without_a_close_one_makes_no_guess() -> None:
    message = str(errors.UnknownNameError("gait", "xyz", iter(["standing", "walking"])))
    assert message == "unknown gait 'xyz'. Valid: standing, walking."


def test_errors_come_back_from_a_worker_process_as_they_were() -> None:
    """Processes send them as pickles; one that cannot be read again looks like a worker that died."""
    for error in (errors.UnknownNameError("gait", "walkin", ["walking"]), errors.ConfigError("seed is -1")):
        back = pickle.loads(pickle.dumps(error))
        assert type(back) is type(error) and str(back) == str(error)
