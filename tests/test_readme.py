"""What the README shows runs, and what the documents point at exists."""

import pathlib
import re

import pytest
from docs_pages import ROOT, blocks

from hugwbc.cli import VERBS

README = ROOT / "README.md"
CODE = [block for block in blocks(README) if block.language == "python"]
PAGES = [
    *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")),
    *sorted(page for folder in ("docs", "models") for page in (ROOT / folder).rglob("*.md")),
]


@pytest.mark.parametrize("block", CODE, ids=lambda block: f"line {block.line}")
def test_python_block_runs(block, capsys):
    exec(compile(block.text, str(README), "exec"), {})
    out = capsys.readouterr().out
    assert out.strip() and "fell True" not in out


def test_there_is_code_for_each_pillar():
    code = "".join(block.text for block in CODE)
    for pillar in ('"learned"', '"qp"', "UpperBodySource"):
        assert pillar in code


def test_every_verb_is_mentioned_and_no_other():
    assert set(re.findall(r"`hugwbc ([\w-]+)", README.read_text())) == set(VERBS)


def anchors(page: pathlib.Path) -> set[str]:
    """Return the anchors of a page's headings: lower case, without punctuation, hyphens for spaces."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_local_links_and_pictures_exist(page):
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    for target, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]+))?\)", text):
        path = (page.parent / target).resolve() if target else page
        if path.parent == ROOT / "docs" / "api" and path.name != "index.md":
            # Built from the docstrings of the package of that name.
            path = ROOT / "hugwbc" / ("" if path.stem == "core" else path.stem.replace(".", "/")) / "__init__.py"
        assert path.exists(), target
        assert not anchor or anchor in anchors(path), f"{target}#{anchor}"
