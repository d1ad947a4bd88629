"""House rules that a linter does not check: no unsafe loading, no print outside the command line, documented names."""

import ast
import pathlib
from collections.abc import Iterator

import pytest

import hugwbc

ROOT = pathlib.Path(hugwbc.__file__).parent
FILES = sorted(ROOT.rglob("*.py"))
UNSAFE_MODULES = {"pickle", "dill", "shelve", "marshal"}
UNSAFE_CALLS = {"eval", "exec", "yaml.load", "yaml.unsafe_load", "yaml.full_load", "os.system", "os.popen"}


def _dotted(node: ast.AST) -> str:
    if isinstance(node, ast.Attribute):
        return f"{_dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def _keyword_is(call: ast.Call, name: str, value: object) -> bool:
    return any(k.arg == name and isinstance(k.value, ast.Constant) and k.value.value is value for k in call.keywords)


def _faults(source: str, *, may_print: bool) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and any(alias.name == "*" for alias in node.names):
            yield "import *"
        if isinstance(node, ast.Import | ast.ImportFrom):
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names]
            yield from (f"import {module}" for module in modules if module.split(".")[0] in UNSAFE_MODULES)
        if isinstance(node, ast.Call):
            name = _dotted(node.func)
            if name in UNSAFE_CALLS:
                yield f"{name}()"
            if name == "print" and not may_print:
                yield "print()"
            if _keyword_is(node, "shell", True):
                yield "shell=True"
            if name == "torch.load" and not _keyword_is(node, "weights_only", True):
                yield "torch.load without weights_only=True"


def _undocumented(tree: ast.Module) -> Iterator[str]:
    """Public functions, classes and methods without a docstring, and the module itself."""
    if ast.get_docstring(tree) is None:
        yield "module"
    scopes: list[tuple[str, list[ast.stmt]]] = [("", tree.body)]
    while scopes:
        prefix, body = scopes.pop()
        for node in body:
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                continue
            if node.name.startswith("_"):
                continue
            if ast.get_docstring(node) is None:
                yield prefix + node.name
            if isinstance(node, ast.ClassDef):
                scopes.append((f"{node.name}.", node.body))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_file_keeps_to_the_house_rules(path: pathlib.Path) -> None:
    source = path.read_text()
    relative = path.relative_to(ROOT)
    assert list(_faults(source, may_print=relative.parts[0] == "cli")) == []
    assert list(_undocumented(ast.parse(source))) == []


def test_the_checks_see_what_they_look_for() -> None:
    bad = """
from os import *
import pickle
import torch, yaml, subprocess
print(1)
eval("1")
yaml.load("a")
subprocess.run("ls", shell=True)
torch.load("f")
torch.load("f", weights_only=False)
torch.load("f", weights_only=True)
def f(): ...
class C:
    def method(self): ...
    def _private(self): ...
"""
    assert sorted(_faults(bad, may_print=False)) == sorted(
        ["import *", "import pickle", "print()", "eval()", "yaml.load()", "shell=True"]
        + ["torch.load without weights_only=True"] * 2
    )
    assert sorted(_undocumented(ast.parse(bad))) == ["C", "C.method", "f", "module"]
