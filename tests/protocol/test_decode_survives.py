"""Whatever comes over the wire, decoding ends in a packet or in a WireError with a sentence."""

from __future__ import annotations

import both_codecs as both
import numpy as np
import pytest
import random_fields
import slow_packer as slow
from hypothesis import given, settings
from hypothesis import strategies as st
from ribbonhost import wire

KNOWN = [p["id"] for p in slow.PACKETS.values()]
THOROUGH = settings(derandomize=True, deadline=None, max_examples=1500)


def reasons(data: bytes) -> str:
    """Empty if it decodes, else the sentence."""
    try:
        packet, surplus = wire.decode(data)
    except wire.WireError as error:
        return str(error)
    assert 0 <= surplus < len(data)
    assert both.class_of(wire.PacketId(data[0]).name.lower()) is type(packet)
    return ""


@given(st.binary(max_size=700))
@THOROUGH
def test_any_bytes_decode_or_raise_a_wire_error(data: bytes) -> None:
    sentence = reasons(data)
    assert not sentence or (sentence.endswith(".") and sentence.count(".") == 1)


@given(st.sampled_from(KNOWN), st.binary(max_size=700))
@THOROUGH
def test_any_bytes_behind_a_known_type_decode_or_raise_a_wire_error(kind: int, rest: bytes) -> None:
    reasons(bytes([kind]) + rest)


@given(st.binary(max_size=4000))
@settings(derandomize=True, deadline=None, max_examples=300)
def test_any_bytes_are_a_record_or_raise_malformed(data: bytes) -> None:
    try:
        record = wire.Calibration.unpack(data)
    except wire.MalformedPacketError:
        return
    assert len(record.slots) == data[3]


def test_each_cut_of_each_golden_packet_is_malformed() -> None:
    for name in slow.PACKETS:
        counters = ("slot_count", "health_count", "node_count", "accel_count", "data_count")
        fields = {**dict.fromkeys(counters, 2), "mag_count": 1}
        packet = both.c_pack(name, minimal(name, fields))
        for n in range(1, len(packet)):
            with pytest.raises(wire.MalformedPacketError, match=f"ends after {n} bytes"):
                wire.decode(packet[:n])
        assert wire.decode(packet)[1] == 0
        assert wire.decode(packet + b"\0" * 5)[1] == 5


def minimal(name: str, counts: dict[str, int]) -> dict[str, object]:
    """Zeros in all fields, arrays of these lengths."""
    values: dict[str, object] = {}
    for row in both.rows_of(name):
        count = counts.get(str(row.get("count")), row.get("count"))
        if row["name"] in counts and both.is_counter(name, row):
            values[row["name"]] = counts[row["name"]]
        elif "struct" in row:
            values[row["name"]] = [minimal(row["struct"], {}) for _ in range(int(count))]
        elif row.get("type") in slow.QUATERNIONS:
            values[row["name"]] = [1.0, 0.0, 0.0, 0.0]
        elif count is not None:
            values[row["name"]] = "00" * count if row["type"] == "u8" else [0] * count
        else:
            values[row["name"]] = 0
    return values


def test_empty_packet_and_unknown_types_are_told_apart() -> None:
    with pytest.raises(wire.MalformedPacketError):
        wire.decode(b"")
    for kind in set(range(256)) - set(KNOWN):
        with pytest.raises(wire.UnknownPacketError, match=f"0x{kind:02x}"):
            wire.decode(bytes([kind]) + bytes(20))


def test_values_unknown_to_this_version_are_kept() -> None:
    packet = both.c_pack("command", {"tag": 1, "command": 99, "argument": 0, "data_count": 0, "data": ""})
    command, _ = wire.decode(packet)
    assert isinstance(command, wire.Command)
    assert command.command == 99
    assert wire.encode(command) == packet
    info, _ = wire.decode(
        both.c_pack("info", minimal("info", {"slot_count": 0}) | {"board": 200, "mode": 0xC1})
    )
    assert isinstance(info, wire.Info)
    assert info.board == 200
    assert info.mode & wire.Mode.ORIENT
    assert int(info.mode) == 0xC1
    known, _ = wire.decode(both.c_pack("info", minimal("info", {"slot_count": 0}) | {"board": 1}))
    assert isinstance(known, wire.Info)
    assert known.board is wire.Board.PYBOARD_V11


def test_decoded_arrays_are_their_own() -> None:
    """A view of the packet would keep it alive, and could not be handed on as contiguous memory."""
    packet = bytearray(both.c_pack("orient", minimal("orient", {"node_count": 3})))
    orient, _ = wire.decode(packet)
    assert isinstance(orient, wire.Orient)
    packet[:] = b"\xff" * len(packet)
    nodes = orient.nodes
    assert np.array_equal(nodes.q_world_node, [[1.0, 0.0, 0.0, 0.0]] * 3)
    for array in (nodes.q_world_node, nodes.valid, nodes.quality):
        assert array.flags.c_contiguous
        assert array.flags.writeable
        array[:] = 0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"t_us": 1 << 32}, "Orient.t_us is 4294967296, but must be 0 to 4294967295."),
        ({"sequence": -1}, "Orient.sequence is -1, but must be 0 to 65535."),
        ({"sequence": 1.5}, "Orient.sequence is 1.5, but must be an integer."),
        ({"quality": np.array([256, 0])}, "Orient.nodes.quality holds 0 to 256, but must be 0 to 255."),
        ({"quality": np.zeros(3, int)}, "Orient.nodes.quality is int64 (3,), but must be integers (2,)."),
        (
            {"q_world_node": np.zeros((2, 3))},
            "Orient.nodes.q_world_node is float64 (2, 3), but must be numbers (2, 4).",
        ),
        (
            {"valid": np.ones(2)},
            "Orient.nodes.q_world_node has a valid of float64 (2,), but it must be bool (2,).",
        ),
    ],
)
def test_values_that_do_not_fit_are_refused_by_name(change: dict[str, object], sentence: str) -> None:
    arrays = {"q_world_node": np.eye(4)[:2], "valid": np.ones(2, bool), "quality": np.zeros(2, np.uint8)}
    scalars: dict[str, object] = {"t_us": 0, "sequence": 0}
    nodes = wire.NodeArray(**{k: change.get(k, v) for k, v in arrays.items()})  # type: ignore[arg-type]
    orient = wire.Orient(**{k: change.get(k, v) for k, v in scalars.items()}, nodes=nodes)  # type: ignore[arg-type]
    with pytest.raises(wire.WireError) as caught:
        wire.encode(orient)
    assert str(caught.value) == sentence


def test_too_many_items_and_foreign_objects_are_refused() -> None:
    with pytest.raises(wire.WireError, match=r"Command\.data has 193 items, more than the 192"):
        wire.encode(wire.Command(tag=0, command=1, argument=0, data=bytes(193)))
    with pytest.raises(wire.WireError, match="is not a packet"):
        wire.encode(object())  # type: ignore[arg-type]


@given(st.sampled_from(random_fields.NAMES), st.data())
@settings(derandomize=True, deadline=None, max_examples=100)
def test_values_are_frozen(name: str, data: st.DataObject) -> None:
    value = both.python_value(name, data.draw(random_fields.fields(name)))
    with pytest.raises(AttributeError):
        value.__setattr__(both.rows_of(name)[0]["name"], 0)
