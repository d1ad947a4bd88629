"""The luggage of a GPU window: what is left out, and that it arrives whole."""

import os
import struct
import subprocess
import sys

import pytest


@pytest.fixture(scope="module")
def gpu_window(load_tool):
    return load_tool("gpu_window")


def code(capability: int, size: int) -> bytes:
    """Machine code of one GPU in a fat binary."""
    header = struct.pack("<HHIQ", 2, 1, 64, size).ljust(64, b"\1")
    return header[:28] + struct.pack("<I", capability) + header[32:] + b"\7" * size


def library(*parts: bytes) -> bytes:
    return b"before" + struct.pack("<IHHQ", 0xBA55ED50, 1, 16, sum(map(len, parts))) + b"".join(parts) + b"after"


def test_the_code_of_other_gpus_is_left_out_and_the_rest_stays_in_its_place(gpu_window):
    before = library(code(70, 40), code(90, 24), code(120, 8)) + library(code(90, 8))
    after = gpu_window.pruned(before)
    assert len(after) == len(before) and after.count(b"\7") == 24 + 8
    assert after.replace(bytes(40), b"\7" * 40, 1).count(b"\7") == 24 + 8 + 40
    assert after.endswith(library(code(90, 8))) and gpu_window.pruned(b"no library") == b"no library"


def test_packages_arrive_whole_in_parts(gpu_window, tmp_path, monkeypatch, capsys):
    site = tmp_path / "site"
    (site / "warp" / "bin").mkdir(parents=True)
    (site / "warp" / "bin" / "warp.so").write_bytes(library(code(90, 3000)))
    (site / "warp" / "bin" / "warp-clang.so").write_bytes(b"for processors")
    (site / "warp" / "config.py").write_text("quiet = True")
    monkeypatch.setattr(gpu_window, "PART", 100)
    gpu_window.pack(tmp_path / "parts", site)
    assert len(list((tmp_path / "parts").iterdir())) > 1 and "parts" in capsys.readouterr().out
    gpu_window.unpack(tmp_path / "parts", tmp_path / "there")
    there = tmp_path / "there"
    found = {str(path.relative_to(there)): path.read_bytes() for path in there.rglob("*") if path.is_file()}
    empty = [found.pop(f"{name}.py") for name in gpu_window.UNUSED]
    assert found == {"warp/bin/warp.so": library(code(90, 3000)), "warp/config.py": b"quiet = True"}
    assert set(empty) == {gpu_window.EMPTY.encode()}


def test_training_is_imported_without_the_packages_of_the_qp(gpu_window, tmp_path):
    """Theirs are larger than what may travel to a borrowed machine."""
    gpu_window.pack(tmp_path / "parts", tmp_path)
    gpu_window.unpack(tmp_path / "parts", tmp_path)
    code = (
        "from hugwbc.evaluation import recipe_services; from hugwbc.learned.recipe import run; import pinocchio as pin"
    )
    command = [sys.executable, "-c", f"{code}; print(pin.__file__)"]
    ran = subprocess.run(command, env=os.environ | {"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True)
    assert (ran.stdout.strip(), ran.returncode) == (str(tmp_path / "pinocchio.py"), 0), ran.stderr
