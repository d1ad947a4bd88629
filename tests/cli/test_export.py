import sys

from hugwbc.cli import main


def test_export_writes_a_file_that_agrees(tmp_path, capsys):
    path = tmp_path / "policy.onnx"
    assert main(["export", "--policy", "h1", "--out", str(path)]) == 0
    assert "differs from torch by" in capsys.readouterr().out
    assert path.stat().st_size > 500_000


def test_export_without_onnx_says_what_to_install(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    assert main(["export", "--out", str(tmp_path / "x.onnx")]) == 2
    assert "pip install 'hugwbc[export]'" in capsys.readouterr().err
