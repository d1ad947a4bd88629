"""Hook of MkDocs: pages from outside `docs/`, one page of API reference for each package, and formulas as MathML.

Everything here happens at build time, in memory: no generated page lies in the repository. `make docs` uses it.
"""

import ast
import html
import pathlib
import posixpath
import re
from collections.abc import Iterator

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = pathlib.Path(__file__).parents[1]
DOCS = "docs"
# Markdown files outside docs/ that the site shows, and the place of each in it.
OUTSIDE = {
    "README.md": "index.md",
    "CHANGELOG.md": "CHANGELOG.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "models/h1/README.md": "robot.md",
    "models/g1/README.md": "robot-g1.md",
}
# Rooms of the package from the lowest layer to the highest; the reference lists them in this order.
LAYERS = (
    "core",
    "scripts",
    "behaviours",
    "sim",
    "learned",
    "mbc",
    "upper_ik",
    "runtime",
    "deploy",
    "viz",
    "tasks",
    "gym",
    "evaluation",
    "report",
    "cli",
)
API_SECTION = "API reference"
PACKAGE_TABLE = "<!-- packages -->"  # where docs/api/index.md has the table of all packages
LOG_SECTION = "Log"
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', flags=re.DOTALL)
_FENCED = re.compile(r"(^```.*?^```[ ]*$)", flags=re.DOTALL | re.MULTILINE)


def packages() -> Iterator[tuple[str, list[str]]]:
    """Yield each package of `hugwbc` with its public modules, the package itself first, in the order of the layers."""

    def place(folder: pathlib.Path) -> tuple[int, pathlib.Path]:
        room = folder.relative_to(ROOT / "hugwbc").parts[:1] or ("core",)
        return (LAYERS.index(room[0]) if room[0] in LAYERS else len(LAYERS)), folder

    for folder in sorted((init.parent for init in ROOT.glob("hugwbc/**/__init__.py")), key=place):
        name = ".".join(folder.relative_to(ROOT).parts)
        modules = [path.stem for path in sorted(folder.glob("*.py")) if not path.stem.startswith("_")]
        yield name, [name, *(f"{name}.{module}" for module in modules)]


def reference(module: str) -> str:
    """Return the directive that documents a module.

    What a package re-exports is documented in the module that defines it; the package's entry links there.
    """
    path = ROOT / module.replace(".", "/")
    if not path.is_dir():
        return f"::: {module}"
    body = ast.parse((path / "__init__.py").read_text()).body
    own = [node.name for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name[0] != "_"]
    links = [
        f"[`{alias.name}`][{node.module}.{alias.name}]"
        for node in body
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("hugwbc")
        for alias in node.names
        if not alias.name.isupper()  # constants have no entry of their own
    ]
    lines = [f"::: {module}", "    options:", f"      members: {own or 'false'}"]
    return "\n".join(lines) + (f"\n\n`from {module} import` gives {', '.join(links)}." if links else "")


def summary(package: str) -> str:
    """Return the first line of a package's docstring."""
    source = (ROOT / package.replace(".", "/") / "__init__.py").read_text()
    return (ast.get_docstring(ast.parse(source)) or "").partition("\n")[0]


def title(package: str) -> str:
    """Return the name under which a package stands in the navigation."""
    return "core" if package == "hugwbc" else package.removeprefix("hugwbc.")


def package_table() -> str:
    """Return a table of all packages, with links to their pages."""
    rows = [f"| [{title(name)}]({title(name)}.md) | {summary(name)} |" for name, _ in packages()]
    return "\n".join(["| package | what |", "|---|---|", *rows])


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Fill the navigation with what is found: the API pages, and the log where there is one."""
    assert config.nav is not None
    (section,) = (entry for entry in config.nav if API_SECTION in entry)
    section[API_SECTION] = ["api/index.md", *({title(name): f"api/{title(name)}.md"} for name, _ in packages())]
    logs = [f"log/{path.name}" for path in sorted((ROOT / DOCS / "log").glob("*.md"))]
    if logs:
        config.nav.append({LOG_SECTION: logs})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages from outside `docs/` and the API pages."""
    for source, target in OUTSIDE.items():
        files.append(File.generated(config, target, content=(ROOT / source).read_text()))
    for name, modules in packages():
        text = "\n\n".join([f"# {title(name)}", *map(reference, modules)])
        files.append(File.generated(config, f"api/{title(name)}.md", content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Point links at pages of the site; a link to any other file becomes its text."""
    uri = page.file.src_uri
    places = {place: source for source, place in OUTSIDE.items()}
    here = posixpath.dirname(places.get(uri, f"{DOCS}/{uri}"))

    def rewritten(match: re.Match[str]) -> str:
        picture, text, target = match.groups()
        path, hash_mark, anchor = target.partition("#")
        if not path or re.match(r"[a-z]+:", path):
            return match.group()
        source = posixpath.normpath(posixpath.join(here, path))
        place = OUTSIDE.get(source, source.removeprefix(f"{DOCS}/"))
        if files.get_file_from_path(place) is not None:
            link = posixpath.relpath(place, posixpath.dirname(uri) or ".")
            return f"{picture}[{text}]({link}{hash_mark}{anchor})"
        # Sources are in the repository, not on the site. A path that does not exist is left to MkDocs' own check.
        return text if (ROOT / source).exists() and not picture else match.group()

    parts = _FENCED.split(markdown)
    text = "".join(part if part.startswith("```") else _LINK.sub(rewritten, part) for part in parts)
    text = text.replace(" ± ", " ±\N{NO-BREAK SPACE}")  # a narrow column keeps an uncertainty in one line
    return text.replace(PACKAGE_TABLE, package_table())


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Write formulas as MathML, which browsers draw by themselves: no script, no fonts, no network."""

    def drawn(match: re.Match[str]) -> str:
        _, bracket, formula = match.groups()
        mathml = convert(html.unescape(formula), display="block" if bracket == "[" else "inline")
        return mathml.replace("<mover>", '<mover accent="true">')  # dots and hats at full size

    return _FORMULA.sub(drawn, content)
