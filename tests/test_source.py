"""The commit that says which code has run."""

import subprocess

import hugwbc
from hugwbc import source
from hugwbc.source import short_commit, source_commit


def commit_all(folder):
    git = ["git", "-C", str(folder), "-c", "user.name=one", "-c", "user.email=one@example.org"]
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "one"]):
        subprocess.run([*git, *words], check=True)


def test_a_change_of_what_runs_changes_the_commit_and_of_what_shows_does_not(tmp_path, monkeypatch):
    package = tmp_path / "hugwbc"
    package.mkdir()
    (package / "__init__.py").write_text("")
    commit_all(tmp_path)
    monkeypatch.setattr(hugwbc, "__file__", str(package / "__init__.py"))
    commits = [source_commit.__wrapped__()]
    for name, text in (
        ("__init__.py", "a = 1\n"), ("added.py", "a = 1\n"), ("added.py", "a = 2\n"), ("scene.yaml", "a: 1\n"),
    ):  # fmt: skip
        (package / name).write_text(text)
        commits.append(source_commit.__wrapped__())
    (tmp_path / "notes.py").write_text("nothing that runs")
    assert len(set(commits)) == 5 and commits[-1] == source_commit.__wrapped__()
    assert all(commit.startswith(commits[0]) for commit in commits)
    commit_all(tmp_path)
    before = source_commit.__wrapped__()
    (package / "notes.md").write_text("nothing that runs")
    (package / "viz").mkdir()
    (package / "viz" / "drawn.py").write_text("colour = 1")
    assert source_commit.__wrapped__() == before
    commit_all(tmp_path)
    assert source_commit.__wrapped__() == before
    (package / "viz" / "drawn.py").write_text("colour = 2")
    assert source_commit.__wrapped__() == before


def test_without_git_a_change_of_what_runs_counts_too(tmp_path, monkeypatch):
    for name in ("hugwbc/__init__.py", "hugwbc/viz/drawn.py", "models/h1/h1.yaml", "models/h1/policies/a/policy.yaml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("one: 1")
    monkeypatch.setattr(hugwbc, "__file__", str(tmp_path / "hugwbc" / "__init__.py"))
    kinds = ({}, {"policies": False})
    before = [source_commit.__wrapped__(**kind) for kind in kinds]
    (tmp_path / "hugwbc" / "viz" / "drawn.py").write_text("two")
    assert [source_commit.__wrapped__(**kind) for kind in kinds] == before
    (tmp_path / "models" / "h1" / "policies" / "a" / "policy.yaml").write_text("one: 2")
    assert [source_commit.__wrapped__(**kind) == was for kind, was in zip(kinds, before, strict=True)] == [False, True]
    (tmp_path / "models" / "h1" / "h1.yaml").write_text("one: 2")
    assert source_commit.__wrapped__(policies=False) != before[1]


def test_results_of_one_controller_outlive_the_policy_of_another(tmp_path, monkeypatch):
    for folder in ("hugwbc", "models/h1/policies/one", "models/h1/recipes"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "hugwbc" / "__init__.py").write_text("")
    (tmp_path / "models" / "h1" / "h1.xml").write_text("a robot")
    commit_all(tmp_path)
    monkeypatch.setattr(hugwbc, "__file__", str(tmp_path / "hugwbc" / "__init__.py"))
    commit, without = source_commit.__wrapped__(), source_commit.__wrapped__(policies=False)
    for name in ("policies/one/policy.safetensors", "recipes/one.yaml"):
        (tmp_path / "models" / "h1" / name).write_text("a policy")
    commit_all(tmp_path)
    assert source_commit.__wrapped__() != commit == without == source_commit.__wrapped__(policies=False)
    (tmp_path / "models" / "h1" / "h1.xml").write_text("another robot")
    assert source_commit.__wrapped__(policies=False) != without


def test_a_comment_or_a_docstring_makes_no_result_old(tmp_path, monkeypatch):
    package = tmp_path / "hugwbc"
    package.mkdir()
    (tmp_path / "models").mkdir()
    (package / "__init__.py").write_text('"""One."""\n\ndef run():\n    """Return one."""\n    return 1  # one\n')
    (tmp_path / "models" / "one.yaml").write_text("mass: 1\n")
    commit_all(tmp_path)
    monkeypatch.setattr(hugwbc, "__file__", str(package / "__init__.py"))
    before = source_commit.__wrapped__()
    (package / "__init__.py").write_text("# Two.\ndef run():\n    return 1\n")
    (tmp_path / "models" / "one.yaml").write_text("# kg\nmass: 1\n")
    assert source_commit.__wrapped__() == before
    commit_all(tmp_path)
    assert source_commit.__wrapped__() == before
    (tmp_path / "models" / "one.yaml").write_text("mass: 2\n")
    commit_all(tmp_path)
    assert source_commit.__wrapped__()[:40] not in (before, "") and "+" not in source_commit.__wrapped__()
    shallow = tmp_path / "shallow"
    subprocess.run(["git", "clone", "-q", "--depth", "1", tmp_path.as_uri(), str(shallow)], check=True)
    after = source_commit.__wrapped__()
    monkeypatch.setattr(hugwbc, "__file__", str(shallow / "hugwbc" / "__init__.py"))
    assert source_commit.__wrapped__() == after


def test_a_modified_tree_stays_apart_from_its_commit_when_this_is_cut(monkeypatch):
    for commit, short in (("0123456789ab" * 3 + "0123", "0123456789ab"), ("0.9.0", "0.9.0")):
        for changes in ("", "+fedc"):
            monkeypatch.setattr(source, "source_commit", lambda made=commit + changes: made)
            assert short_commit() == short + changes
