"""Which room may import which, and that no modules import each other in a circle.

core <- scripts, sim <- {learned, mbc, upper_ik} <- runtime <- {tasks, viz, deploy} <- {evaluation, gym} <- report <-
cli. Behaviours need scripts alone, and tasks are made of them. Evaluation is above tasks, because a protocol of it runs
them; so is gym, whose environments are tasks. Nothing imports gym: it is for other people's learners.
"""

import ast
import functools
import graphlib
import pathlib
import re
import subprocess
import sys

import hugwbc

ROOT = pathlib.Path(hugwbc.__file__).parent
BELOW = frozenset({"core", "scripts", "sim"})
PILLARS = frozenset({"learned", "mbc", "upper_ik"})
RUNTIME = BELOW | PILLARS | {"runtime"}
MAY_IMPORT = {
    "core": frozenset({"core"}),
    "scripts": frozenset({"core", "scripts"}),
    "behaviours": frozenset({"core", "scripts", "behaviours"}),
    "sim": frozenset({"core", "sim"}),
    **{pillar: BELOW | {pillar} for pillar in PILLARS},
    "runtime": RUNTIME,
    "deploy": RUNTIME | {"deploy"},
    "viz": RUNTIME | {"viz"},
    "tasks": RUNTIME | {"behaviours", "tasks"},
    "gym": RUNTIME | {"behaviours", "tasks", "gym"},
    "evaluation": RUNTIME | {"behaviours", "tasks", "viz", "evaluation"},
    "report": RUNTIME | {"tasks", "viz", "evaluation", "report"},
    "cli": RUNTIME | {"behaviours", "deploy", "tasks", "viz", "evaluation", "report", "cli"},
}
HEAVY = ("torch", "pinocchio", "placo", "proxsuite", "meshcat", "matplotlib")


def _room(parts: tuple[str, ...]) -> str:
    """The room of a dotted name or path below hugwbc."""
    return parts[0] if parts and parts[0] in MAY_IMPORT else "core"


@functools.cache
def _names(path: pathlib.Path) -> set[str]:
    """Full names that a file imports, anywhere in it: function bodies, `if TYPE_CHECKING`, `import_module("...")`."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import; write the full name"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            name, brace, _ = ast.unparse(node.args[0]).strip("f'\"").partition("{")
            names.add(name + "*" if brace else name)
    return names


def _imports(path: pathlib.Path) -> set[str]:
    """Rooms of hugwbc that a file imports."""
    return {_room(tuple(name.split(".")[1:])) for name in _names(path) if name.split(".")[0] == "hugwbc"}


def _import_graph(root: pathlib.Path) -> dict[str, set[str]]:
    """Modules of a package by dotted name, and which of them each one imports.

    A name that is not a module is looked for in the package that holds it: `from a.b import c` imports a.b.c where that
    is a module, else a.b. A module that is found by a name put together at run time counts for the layers alone.
    """
    modules = {".".join(path.relative_to(root.parent).with_suffix("").parts): path for path in root.rglob("*.py")}
    modules = {name.removesuffix(".__init__"): path for name, path in modules.items()}
    graph = {}
    for module, path in modules.items():
        found = {name if name in modules else name.rpartition(".")[0] for name in _names(path) if name[-1] != "*"}
        graph[module] = (found & set(modules)) - {module}
    return graph


def _circle(graph: dict[str, set[str]]) -> set[str]:
    """Modules of a circle, each of which imports the next one; empty where there is none."""
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return set(error.args[1])
    return set()


def test_imports_keep_to_the_layers() -> None:
    for path in ROOT.rglob("*.py"):
        assert _imports(path) <= MAY_IMPORT[_room(path.relative_to(ROOT).parts)], path


def test_every_folder_is_a_known_room() -> None:
    folders = {p.name for p in ROOT.iterdir() if p.is_dir() and (p / "__init__.py").exists()}
    assert folders == set(MAY_IMPORT) - {"core"}


def test_the_check_sees_a_forbidden_import(tmp_path: pathlib.Path) -> None:
    texts = {
        "def f():\n from hugwbc.learned import a\n import hugwbc.cli\n from hugwbc import mbc": "learned cli mbc",
        'import importlib\nf = importlib.import_module("hugwbc.viz.show")': "viz",
        'import importlib\nf = importlib.import_module(f"hugwbc.tasks.{name}")': "tasks",
    }
    for number, (text, rooms) in enumerate(texts.items()):
        module = tmp_path / f"module{number}.py"
        module.write_text(text)
        assert _imports(module) == set(rooms.split())


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert _circle(_import_graph(ROOT)) == set()


def test_importing_the_package_stays_light() -> None:
    script = f"import sys, hugwbc; print([name for name in {HEAVY} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_no_module_unpickles_arrays_or_builds_objects_from_yaml() -> None:
    calls = r"allow_pickle=True|\bpickle\.loads?\(|torch\.load\(|\byaml\.(?!safe_)\w*load|Loader=(?!yaml\.CSafeLoader)"
    found = {path: re.findall(calls, path.read_text()) for path in ROOT.rglob("*.py")}
    assert {path: lines for path, lines in found.items() if lines} == {}
