"""The C and the Python codec against each other, on random values and on broken bytes."""

from __future__ import annotations

import both_codecs as both
import numpy as np
import pytest
import random_fields
import slow_packer as slow
from hypothesis import given, settings
from hypothesis import strategies as st
from ribbonhil._firmware import ffi, lib
from ribbonhost import wire

EACH_MESSAGE = pytest.mark.parametrize("name", random_fields.NAMES)
QUICK = settings(derandomize=True, deadline=None, max_examples=40)


@st.composite
def broken(draw: st.DrawFn, name: str) -> bytes:
    """A packed message with bytes changed, cut off or appended."""
    data = bytearray(both.c_pack(name, draw(random_fields.fields(name))))
    for _ in range(draw(st.integers(0, 3))):
        data[draw(st.integers(1, len(data) - 1))] = draw(st.integers(0, 255))
    keep = draw(st.one_of(st.just(len(data)), st.integers(0, len(data))))
    return bytes(data[:keep]) + draw(st.binary(max_size=20))


@EACH_MESSAGE
@given(data=st.data())
@QUICK
def test_both_pack_the_same_bytes_and_read_the_same_values(name: str, data: st.DataObject) -> None:
    fields = data.draw(random_fields.fields(name))
    from_c, from_python = both.c_pack(name, fields), both.python_pack(name, fields)
    assert from_c == from_python
    read_by_c, used = both.c_unpack(name, from_python)
    read_by_python, surplus = both.python_unpack(name, from_c)
    assert (used, surplus) == (len(from_c), 0)
    both.assert_same(name, read_by_c, read_by_python)


@EACH_MESSAGE
@given(data=st.data())
@QUICK
def test_both_find_the_same_fault_in_broken_bytes(name: str, data: st.DataObject) -> None:
    octets = data.draw(broken(name))
    by_c, used = both.c_unpack(name, octets)
    is_packet = name in slow.PACKETS
    try:
        by_python, surplus = both.python_unpack(name, octets)
    except wire.WireError:
        # An empty packet has no type; a record, unlike a packet, may not be longer than its fields.
        assert used < 0 or (not is_packet and used < len(octets))
        return
    assert used == len(octets) - surplus
    both.assert_same(name, by_c, by_python)


@EACH_MESSAGE
@given(data=st.data())
@QUICK
def test_c_packs_nothing_into_too_little_room(name: str, data: st.DataObject) -> None:
    value = both.c_value(name, data.draw(random_fields.fields(name)))
    pack = getattr(lib, f"wire_{name}_pack")
    out = ffi.new("uint8_t[]", b"\xa5" * both.CAPACITY)
    size = pack(value, out, both.CAPACITY)
    assert pack(value, out, size) == size
    ffi.buffer(out)[:] = b"\xa5" * len(ffi.buffer(out))
    assert pack(value, out, size - 1) == 0
    assert set(bytes(ffi.buffer(out))) == {0xA5}


@pytest.mark.parametrize(
    ("name", "counter", "limit"),
    [
        (n, r["name"], lib_limit)
        for n in random_fields.NAMES
        for r in both.rows_of(n)
        if both.is_counter(n, r)
        for lib_limit in [r["range"][1]]
    ],
)
def test_c_refuses_a_count_above_its_limit(name: str, counter: str, limit: int | str) -> None:
    value = ffi.new(f"struct wire_{name} *")
    out = ffi.new("uint8_t[]", both.CAPACITY)
    most = slow.SCHEMA["wire"].get(limit, limit)
    pack = getattr(lib, f"wire_{name}_pack")
    setattr(value, counter, most)
    assert pack(value, out, both.CAPACITY) > 0
    setattr(value, counter, most + 1)
    assert pack(value, out, both.CAPACITY) == 0


def test_c_tells_why_it_does_not_read() -> None:
    ping = bytes([lib.WIRE_PACKET_CLOCK_PING]) + bytes(10)
    value = ffi.new("struct wire_clock_ping *")
    assert lib.wire_clock_ping_unpack(ping, 11, value) == 11
    assert lib.wire_clock_ping_unpack(ping, 10, value) == lib.WIRE_ERROR_TRUNCATED
    assert lib.wire_clock_ping_unpack(ping, 0, value) == lib.WIRE_ERROR_TYPE
    assert (
        lib.wire_clock_ping_unpack(bytes([lib.WIRE_PACKET_CLOCK_PONG]) + ping, 12, value)
        == lib.WIRE_ERROR_TYPE
    )
    command = ffi.new("struct wire_command *")
    packet = wire.encode(wire.Command(tag=5, command=3, argument=9))
    for data_count, error in ((193, lib.WIRE_ERROR_COUNT), (1, lib.WIRE_ERROR_TRUNCATED)):
        broken_packet = packet[:-1] + bytes([data_count])
        assert lib.wire_command_unpack(broken_packet, len(broken_packet), command) == error
        assert (command.tag, command.command) == (5, 3)  # enough to refuse it with an ACK


def test_sigma_codes_are_the_same_and_round_up() -> None:
    table = slow.SCHEMA["sigma_code"]
    steps = [table["smallest_rad"] * table["ratio"] ** c for c in range(table["unknown"])]
    inside = [0.0, 1e-30, *(s * f for s in steps for f in (0.99999, 1.00001)), 10.0, np.inf]
    outside = [np.nan, -1e-9, -np.inf]
    sigma_rad = np.array(inside + outside, np.float32)
    by_c = [lib.wire_sigma_code(float(s)) for s in sigma_rad]
    assert by_c == wire.sigma_code(sigma_rad).tolist()
    expected = [min(sum(s > step for step in steps), 14) for s in inside]
    assert by_c == expected + [table["unknown"]] * len(outside)


def test_sigma_of_a_code_is_the_end_of_its_range() -> None:
    table = slow.SCHEMA["sigma_code"]
    quality = np.arange(256, dtype=np.uint8)
    sigma_rad = wire.sigma_rad(quality)
    expected = [table["smallest_rad"] * table["ratio"] ** c for c in range(15)] + [np.nan]
    np.testing.assert_allclose(sigma_rad, np.array(expected)[quality & 15], rtol=1e-6)
    known = quality[(quality & 15) != table["unknown"]]
    assert (wire.sigma_code(wire.sigma_rad(known) * 0.999999) == known & 15).all()
