import os
import pathlib

import pytest

from hugwbc.files import read_file, write_whole


def test_bytes_and_text_in_a_folder_that_is_made(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "new" / "file.txt"
    write_whole(path, b"\x00\xff")
    assert path.read_bytes() == b"\x00\xff"
    write_whole(path, "1 – 2\n")
    assert path.read_bytes() == b"1 \xe2\x80\x93 2\n"
    assert [entry.name for entry in path.parent.iterdir()] == ["file.txt"]


def test_the_old_file_stays_until_the_new_one_is_complete(tmp_path: pathlib.Path, monkeypatch) -> None:
    path = tmp_path / "file"
    write_whole(path, "old")

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_whole(path, "new")
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_links_and_devices_stay_what_they_are(tmp_path: pathlib.Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "target")
    write_whole(link, "a")
    assert link.is_symlink() and (tmp_path / "target").read_text() == "a"
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_whole(pipe, "b")
        assert os.read(reader, 10) == b"b" and pipe.is_fifo()
    finally:
        os.close(reader)


def test_two_writers_of_one_file_do_not_meet(tmp_path: pathlib.Path, monkeypatch) -> None:
    path, replace = tmp_path / "file", os.replace

    def interrupted(source: pathlib.Path, target: pathlib.Path) -> None:
        monkeypatch.setattr(os, "replace", replace)
        write_whole(path, "of the second")
        assert path.read_text() == "of the second"
        replace(source, target)

    monkeypatch.setattr(os, "replace", interrupted)
    write_whole(path, "of the first")
    assert path.read_text() == "of the first"
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_others_may_read_it_as_far_as_the_mask_lets_them(tmp_path: pathlib.Path) -> None:
    mask = os.umask(0o027)
    try:
        write_whole(tmp_path / "file", "a")
    finally:
        os.umask(mask)
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o640


def test_reading_has_an_end(tmp_path: pathlib.Path) -> None:
    (tmp_path / "a").write_bytes(b"1234")
    assert read_file(tmp_path / "a", 4) == b"1234"
    for path, largest, message in ((tmp_path / "a", 3, "more than 3 bytes"), (pathlib.Path("/dev/zero"), 9, "no file")):
        with pytest.raises(OSError, match=message):
            read_file(path, largest)
