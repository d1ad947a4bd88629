"""Layouts, CDR and the check sum of the maker's messages, against the maker's own package."""

import struct

import numpy as np
import pytest
from unitree_sdk2py.utils import crc

from hugwbc import JointCommand, load_robot
from hugwbc.deploy import wire
from hugwbc.deploy.messages import Messages


def first_command() -> np.ndarray:
    command = wire.record("unitree_go.LowCmd_")
    command["head"], command["level_flag"] = (0xFE, 0xEF), 0xFF
    command["motor_cmd"]["mode"] = [0x0A] * 10 + [0x01] * 10
    return command


KINDS = ["unitree_go.LowCmd_", "unitree_go.LowState_", "unitree_hg.LowCmd_", "unitree_hg.LowState_"]


def test_layouts_have_the_size_of_the_makers_structures() -> None:
    assert [wire.layout(kind).itemsize for kind in KINDS] == [812, 1180, 1004, 2092]
    assert [wire.kind_of(bytes(size)) for size in (812, 1180, 1004, 2092)] == KINDS
    assert wire.kind_of(bytes(100)) == "100 bytes"


def crc_of(content: bytes) -> int:
    """CRC-32/MPEG-2 bit by bit over little-endian words, each from its highest bit on: the maker's algorithm."""
    crc = 0xFFFFFFFF
    for (word,) in struct.iter_unpack("<I", content):
        for bit in range(31, -1, -1):
            carry = crc >> 31 ^ word >> bit & 1
            crc = (crc << 1 & 0xFFFFFFFF) ^ (0x04C11DB7 if carry else 0)
    return crc


def test_a_command_for_the_g1_has_the_makers_layout_and_check_sum() -> None:
    """Byte for byte a structure that is packed here by hand, with the check sum that is computed here."""
    g1 = load_robot("g1")
    ramp = np.arange(29.0)
    command = JointCommand(q=0.01 * ramp, dq=-ramp, kp=g1.kp, kd=g1.kd, tau=0.5 * ramp)
    packed = struct.pack("<BBxx", 0, 5)  # mode_pr: pitch and roll, mode_machine: 29 joints
    for slot in range(29):  # the table's joints are in the order of the maker's slots
        numbers = [float(values[slot]) for values in (command.q, command.dq, command.tau, command.kp, command.kd)]
        packed += struct.pack("<Bxxx5fI", 1, *numbers, 0)
    packed += bytes(6 * 28) + bytes(16)
    assert Messages(g1).pack_command(command) == packed + struct.pack("<I", crc_of(packed))


def test_the_check_sum_of_the_first_command_is_the_makers() -> None:
    command = first_command()
    assert wire.check_sum(command.tobytes()) == 0xA75EDCD6
    command["motor_cmd"]["q"], command["motor_cmd"]["dq"] = 2.146e9, 16000.0
    assert wire.check_sum(command.tobytes()) == 0xF6575A86


def random_message(name: str, rng: np.random.Generator) -> np.ndarray:
    """A record with random numbers, finite where they are floats, small where the maker's own packing needs it."""
    record = wire.record(name)
    structure, _ = wire._places(name)
    content = np.zeros(record.nbytes, dtype=np.uint8)
    content[structure] = rng.integers(0, 128, structure.size, dtype=np.uint8)
    return wire.record(name, content.tobytes())


@pytest.mark.parametrize("name", KINDS)
def test_messages_and_sums_are_those_of_the_makers_package(name: str) -> None:
    rng, kind, maker = np.random.default_rng(1), wire.idl_class(name), crc.CRC()
    for _ in range(10):
        message = wire.sealed(random_message(name, rng))
        read = kind.deserialize(wire.to_cdr(name, message))
        assert wire.check_sum(message) == maker.Crc(read) == read.crc
        assert wire.from_cdr(name, read.serialize()) == message


def test_any_changed_bit_is_noticed() -> None:
    message = bytearray(wire.sealed(first_command()))
    structure, _ = wire._places("unitree_go.LowCmd_")
    rng = np.random.default_rng(3)
    for place in rng.choice(structure, 200):
        changed = bytearray(message)
        changed[place] ^= 1 << int(rng.integers(8))
        assert not wire.is_sealed(bytes(changed))


def test_what_is_no_message_of_this_kind_is_left_out() -> None:
    data = wire.to_cdr("unitree_go.LowCmd_", first_command().tobytes())
    assert wire.from_cdr("unitree_go.LowCmd_", data[:-4]) is None
    assert all(wire.from_cdr(kind, data) is None for kind in KINDS[1:])
    assert wire.from_cdr("unitree_go.LowCmd_", b"\x00\x00" + data[2:]) is None, "big-endian"


def test_a_record_is_sent_without_stray_bytes_in_its_padding() -> None:
    message = wire.sealed(random_message("unitree_go.LowState_", np.random.default_rng(4)))
    assert wire.record("unitree_go.LowState_", message).tobytes() == message
