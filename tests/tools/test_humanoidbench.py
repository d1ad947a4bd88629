"""Episodes of the outside benchmark belong to the code, the policy and the scripts that made them."""

import pytest


@pytest.fixture
def tool(load_tool):
    return load_tool("humanoidbench")


@pytest.fixture
def played(tool, monkeypatch, tmp_path):
    """Run the program in a folder, with episodes that take no time; return the seeds that were played."""
    seeds = []

    def play(task, controller, seed):
        seeds.append(seed)
        return {"return": seed, "bar": 2.5, "task": task}

    def run(*words: str) -> list[int]:
        seeds.clear()
        monkeypatch.setattr("sys.argv", ["humanoidbench", "--first", "1", "--out", str(tmp_path), *words])
        tool.main()
        return list(seeds)

    monkeypatch.setattr(tool, "play", play)
    return run


def test_each_task_has_a_row_with_mean_and_passes(played, capsys) -> None:
    played("--seeds", "4", "--tasks", "walk", "run")
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2:] == ["| walk (2.5) | 2; 2 of 4 | 2; 2 of 4 |", "| run (2.5) | 2; 2 of 4 | 2; 2 of 4 |"]


def test_what_is_stored_is_not_played_again(played, capsys) -> None:
    words = "--tasks", "walk", "--controllers", "qp"
    assert played("--seeds", "2", *words) == [1, 2] and played("--seeds", "3", *words) == [3]
    assert capsys.readouterr().out.endswith("| walk (2.5) | 2; 1 of 3 |  |\n")


@pytest.mark.parametrize("change", ["source_commit", "controller_digest", "versions", "digest_of"])
def test_episodes_of_other_code_are_played_again_and_not_mixed(played, tool, monkeypatch, capsys, change) -> None:
    words = "--tasks", "walk", "--controllers", "qp"
    assert played("--seeds", "3", *words) == [1, 2, 3]
    monkeypatch.setattr(tool, change, lambda *args, **options: "another")
    assert played("--seeds", "2", *words) == [1, 2]
    assert capsys.readouterr().out.endswith("| walk (2.5) | 2; 0 of 2 |  |\n")
