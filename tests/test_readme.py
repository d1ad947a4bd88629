"""What the README shows must run."""

import pathlib
import re

import pytest

from hugwbc.cli import VERBS

README = pathlib.Path(__file__).parents[1] / "README.md"
TEXT = README.read_text()
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, flags=re.DOTALL)


def test_there_is_code_for_each_pillar():
    for pillar in ("hugwbc.learned", "hugwbc.mbc", "hugwbc.upper_ik"):
        assert sum(pillar in block for block in BLOCKS) == 1


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: re.findall(r"hugwbc\.(learned|mbc|upper_ik)", block)[0])
def test_python_block_runs(block, capsys):
    exec(compile(block, str(README), "exec"), {})
    assert capsys.readouterr().out.strip()


def test_every_verb_is_mentioned_and_no_other():
    assert set(re.findall(r"`hugwbc (\w+)", TEXT)) == set(VERBS)


def test_local_links_and_pictures_exist():
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", TEXT):
        assert (README.parent / target).exists(), target
