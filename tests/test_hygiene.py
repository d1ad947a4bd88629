"""What no module may do, beyond what the linter forbids: run code out of data."""

import pathlib

import hugwbc


def test_no_module_unpickles_arrays_or_builds_objects_from_yaml() -> None:
    modules = [path.read_text() for path in pathlib.Path(hugwbc.__file__).parent.rglob("*.py")]
    for call in ("allow_pickle=True", "yaml.unsafe_load"):
        assert not any(call in module for module in modules), call
