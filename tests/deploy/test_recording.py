"""Recordings: what is read is what was written, and a replay gives the same commands bit for bit."""

import json
import os
import pathlib
import threading
import zlib

import pytest
from deploy_bench import RecordedSide, Standing, make_pilot
from local_endpoint import local_pair

from hugwbc import load_robot
from hugwbc.deploy import recording
from hugwbc.deploy.capture import LONGEST
from hugwbc.deploy.messages import TICK, Messages
from hugwbc.deploy.recording import Recorder, Recording, replay
from hugwbc.deploy.relay import Settings
from hugwbc.deploy.robot_side import RobotSide
from hugwbc.deploy.state_machine import Mode
from hugwbc.errors import ConfigError

H1 = load_robot()


def record_a_run(path: pathlib.Path, standing: Standing, *, fault: bool = False) -> None:
    """Record a short deployment with requests by the keyboard and, if asked for, a fault."""
    run = RecordedSide(path, standing)
    for _ in range(50):
        run.slot()
    assert run.side.pilot.mode is Mode.RUN
    run.slot(b"torn")
    if fault:
        run.now += 0.11
        run.side.publish(run.now)
        run.slot()
        assert run.side.pilot.mode is Mode.DAMPING
    run.recorder.close()
    assert run.recorder.failure is None


@pytest.mark.parametrize("fault", [False, True])
def test_a_replay_gives_the_same_commands_bit_for_bit(tmp_path, standing, fault, jumping_pilot) -> None:
    path = tmp_path / "run.bin"
    record_a_run(path, standing, fault=fault)
    pilot = make_pilot()
    result = replay(Recording(path), pilot, Messages(H1), 0.0)
    assert result.states == result.decisions == 82 + fault
    assert result.different == 0 and result.first is None
    assert result.last is not None and abs(result.last.q - standing.reading.q).max() < 1e-4
    assert pilot.mode is (Mode.DAMPING if fault else Mode.RUN)


def test_a_replay_notices_another_controller(tmp_path, standing, jumping_pilot) -> None:
    path = tmp_path / "run.bin"
    record_a_run(path, standing)
    pilot = make_pilot()
    act = pilot.control.guard.controller.act

    def other(*arguments):
        command = act(*arguments)
        command.q[0] += 1e-6
        return command

    pilot.control.guard.controller.act = other  # type: ignore[method-assign]
    result = replay(Recording(path), pilot, Messages(H1), 0.0)
    assert result.different == 50 and result.first is not None


def test_every_message_is_recorded(tmp_path, standing, jumping_pilot) -> None:
    path = tmp_path / "run.bin"
    record_a_run(path, standing)
    entries = list(Recording(path).entries())
    kinds = b"".join(entry.kind for entry in entries)
    assert kinds.count(recording.STATE) == kinds.count(recording.DECISION) == 82
    assert kinds.count(recording.REFUSED) == 1 and kinds.count(recording.PUBLISHED) == 83
    assert [entry.content for entry in entries if entry.kind == recording.REQUEST] == [b"start", b"run"]
    assert Recording(path).header["controller"] == "test"


def test_in_lockstep_the_message_that_was_sent_is_recorded_at_the_time_of_the_robot(tmp_path, standing) -> None:
    path, (robot_end, end) = tmp_path / "run.bin", local_pair()
    recorder = Recorder(path, {"controller": "test"})
    side = RobotSide(make_pilot(), H1, end, Settings(lockstep=True), recorder)
    robot_end.send(standing.raw())
    side.answer(0.0)
    recorder.close()
    (entry,) = [entry for entry in Recording(path).entries() if entry.kind == recording.PUBLISHED]
    assert [entry.content] == robot_end.receive(0.0)
    assert entry.time == standing.tick * TICK


def test_a_recording_that_was_cut_off_can_be_read_up_to_there(tmp_path, standing, jumping_pilot) -> None:
    path = tmp_path / "run.bin"
    record_a_run(path, standing)
    whole = list(Recording(path).entries())
    path.write_bytes(path.read_bytes()[:-200])
    part = list(Recording(path).entries())
    assert 0 < len(part) < len(whole) and part == whole[: len(part)]


def bad(header: bytes, body: bytes) -> bytes:
    return header + b"\n" + body


HEADER = json.dumps({"format": recording.FORMAT}).encode()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no header"),
        (b"\x00\xff\n", "no header"),
        (b"[" * 100_000 + b"\n", "no header"),
        (b"[1, 2]\n", "format"),
        (b'{"format": "other"}\n', "format"),
        (bad(HEADER, b"not zlib"), "damaged"),
        (bad(HEADER, zlib.compress(b"Z" * 100)), "damaged"),
        (bad(HEADER, zlib.compress(b"S" + b"\xff" * 100)), "damaged"),
    ],
)
def test_files_that_are_no_recordings_are_refused(tmp_path, content, words) -> None:
    path = tmp_path / "bad.bin"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=words):
        list(Recording(path).entries())


def test_paths_that_cannot_be_used_are_refused(tmp_path) -> None:
    with pytest.raises(ConfigError, match="no recording"):
        Recording(tmp_path / "missing.bin")
    with pytest.raises(ConfigError, match="no recording"):
        Recording(pathlib.Path("/dev/zero"))
    with pytest.raises(ConfigError, match="cannot write"):
        Recorder(tmp_path / "no" / "folder.bin", {})


def test_a_bomb_is_read_piece_by_piece(tmp_path) -> None:
    """100 MB of zeros in 100 kB: the first entry is damaged, and that is all that is looked at."""
    path = tmp_path / "bomb.bin"
    path.write_bytes(bad(HEADER, zlib.compress(bytes(100_000_000))))
    with pytest.raises(ConfigError, match="damaged"):
        list(Recording(path).entries())


@pytest.mark.parametrize("entries", [2000, 12])
def test_a_full_disk_leaves_the_deployment_alone(entries) -> None:
    """Twelve entries are written only at the end."""
    recorder = Recorder(pathlib.Path("/dev/full"), {})
    for _ in range(entries):
        recorder.add(recording.FAULT, 0.0, os.urandom(1000))
    closing = threading.Thread(target=recorder.close, daemon=True)
    closing.start()
    closing.join(10.0)
    assert not closing.is_alive()
    assert recorder.failure is not None and "space" in recorder.failure


def test_the_longest_text_can_be_read_again(tmp_path) -> None:
    path, text = tmp_path / "run.bin", "\U0001f4e6" * LONGEST
    recorder = Recorder(path, {})
    recorder.add(recording.SEEN, 0.0, text.encode())
    recorder.add(recording.REFUSED, 0.0, bytes(10 * len(text)))
    recorder.add(recording.FAULT, 0.0, b"late")
    recorder.close()
    contents = [entry.content for entry in Recording(path).entries()]
    assert contents[0].decode() == text and contents[2] == b"late", "what is longer was cut off"
