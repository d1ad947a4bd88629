"""Which room may import which, and that no two modules import each other.

core <- scripts, sim <- {learned, mbc, upper_ik} <- runtime <- {viz, evaluation, benchmarks} <- report <- cli.
"""

import ast
import pathlib
import subprocess
import sys

import pytest

import hugwbc

ROOT = pathlib.Path(hugwbc.__file__).parent
BELOW = frozenset({"core", "scripts", "sim"})
PILLARS = frozenset({"learned", "mbc", "upper_ik"})
RUNTIME = BELOW | PILLARS | {"runtime"}
MAY_IMPORT = {
    "core": frozenset({"core"}),
    "scripts": frozenset({"core", "scripts"}),
    "sim": frozenset({"core", "sim"}),
    **{pillar: BELOW | {pillar} for pillar in PILLARS},
    "runtime": RUNTIME,
    "viz": RUNTIME | {"viz"},
    "evaluation": RUNTIME | {"evaluation"},
    "benchmarks": RUNTIME | {"evaluation", "benchmarks"},
    "report": RUNTIME | {"viz", "evaluation", "report"},
    "cli": RUNTIME | {"viz", "evaluation", "benchmarks", "report", "cli"},
}
HEAVY = ("torch", "pinocchio", "placo", "proxsuite", "meshcat", "matplotlib")


def _room(parts: tuple[str, ...]) -> str:
    """The room of a dotted name or path below hugwbc."""
    return parts[0] if parts and parts[0] in MAY_IMPORT else "core"


def _imports(path: pathlib.Path) -> set[str]:
    """Rooms of hugwbc that a file imports, anywhere in it, function bodies included."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import; write the full name"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {_room(tuple(name.split(".")[1:])) for name in names if name.split(".")[0] == "hugwbc"}


FILES = sorted(ROOT.rglob("*.py"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_keep_to_the_layers(path: pathlib.Path) -> None:
    room = _room(path.relative_to(ROOT).parts)
    assert _imports(path) <= MAY_IMPORT[room]


def test_every_folder_is_a_known_room() -> None:
    folders = {p.name for p in ROOT.iterdir() if p.is_dir() and (p / "__init__.py").exists()}
    assert folders <= set(MAY_IMPORT) - {"core"}


def test_the_check_sees_a_forbidden_import(tmp_path: pathlib.Path) -> None:
    module = tmp_path / "module.py"
    module.write_text(
        "def f():\n    from hugwbc.learned import policy\n    import hugwbc.cli\n    from hugwbc import mbc\n"
    )
    assert _imports(module) == {"learned", "cli", "mbc"}


def test_importing_the_package_stays_light() -> None:
    script = f"import sys, hugwbc; print([name for name in {HEAVY} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
