"""What PROTOCOL.md works out by example is what the codecs do."""

from __future__ import annotations

import math
import re

import numpy as np
import slow_packer as slow
from ribbonhost import framing, wire

TEXT = (slow.PROTOCOL / "PROTOCOL.md").read_text(encoding="utf-8")
EXAMPLE = TEXT.split("## One packet, byte by byte")[1]
HALF_TURN_RAD = math.radians(60) / 2


def example() -> wire.Orient:
    """The packet that the text describes."""
    nodes = wire.NodeArray(
        q_world_node=np.array([[math.cos(HALF_TURN_RAD), 0, 0, math.sin(HALF_TURN_RAD)], [np.nan] * 4]),
        valid=np.array([True, False]),
        quality=wire.sigma_code([math.radians(1), np.nan]) | np.array([wire.Quality.MOVING, 0], np.uint8),
    )
    return wire.Orient(t_us=1_000_000, sequence=258, nodes=nodes)


def test_worked_packet_is_what_the_codec_writes() -> None:
    rows = re.findall(r"^\| `([0-9a-f ]+)` \| (\S+)", EXAMPLE, re.MULTILINE)
    content = bytes.fromhex("".join(octets for octets, _ in rows))
    packet = wire.encode(example())
    assert content == packet + framing.crc16(packet).to_bytes(2, "little")
    fields = [f["name"] for f in slow.PACKETS["orient"]["fields"][:-1]]
    assert [name for _, name in rows[:4]] == ["type", *fields]
    (frame,) = re.findall(r"^    ((?:[0-9a-f]{2} ){20,}00)$", EXAMPLE, re.MULTILINE)
    assert bytes.fromhex(frame) == framing.encode_frame(packet) == slow.frame(packet)


def test_worked_numbers_are_right() -> None:
    orient, surplus = wire.decode(wire.encode(example()))
    assert isinstance(orient, wire.Orient)
    assert surplus == 0
    (text,) = re.findall(r"A reader gets q = \[(.*?)\]", EXAMPLE)
    np.testing.assert_allclose(orient.nodes.q_world_node[0], [float(c) for c in text.split(",")], atol=5e-7)
    (turned,) = re.findall(r"back, turned by ([\d.]+) degrees", EXAMPLE)
    angle_deg = 2 * math.degrees(math.asin(orient.nodes.q_world_node[0, 3]))
    assert abs(angle_deg - float(turned)) < 5e-5
    (word,) = re.findall(r"= (0x[0-9A-F]{12}) ", EXAMPLE)
    assert int(word, 16) == 16383 * 2**2 + 16383 * 2**17 + 27968 * 2**32 + 2**47
    assert f"{16383 + 0.5 * math.sqrt(2) * 16383:.2f}" in EXAMPLE


def test_sizes_that_the_text_tells_are_right() -> None:
    def frame_bytes(packet_bytes: int) -> int:
        content = packet_bytes + framing.CRC_BYTES
        return content + math.ceil(content / 254) + 1

    def packet_bytes(name: str, **counts: int) -> int:
        structs = {"nodes": {"orient": 7, "orient_compact": 5}.get(name, 0), "accels": 7, "mags": 10}
        fixed = {"orient": 8, "orient_compact": 8, "raw": 9 + 6 * 2}[name]
        return fixed + sum(structs[array] * n for array, n in counts.items())

    orient = frame_bytes(packet_bytes("orient", nodes=16))
    compact = frame_bytes(packet_bytes("orient_compact", nodes=16))
    raw = frame_bytes(packet_bytes("raw", accels=16, mags=16))
    told = re.findall(r"16 nodes is at most (\d+) bytes, of ORIENT_COMPACT (\d+), of RAW (\d+)", TEXT)
    assert told == [(str(orient), str(compact), str(raw))]
    rates = re.findall(r"ORIENT goes at (\d+) Hz and ORIENT_COMPACT at (\d+) Hz", TEXT)
    ((orient_hz, compact_hz),) = rates
    # STATUS of 32 slots once a second, and as much again for answers.
    spare = 115_200 // 10 - 2 * frame_bytes(55 + 3 * 32)
    assert int(orient_hz) <= spare / orient
    assert int(compact_hz) <= spare / compact
    assert f"1 to {wire.MAX_PACKET_BYTES} bytes, hence a frame at most {framing.MAX_COBS_BYTES}" in TEXT
    assert f"longer than {framing.MAX_CONTENT_BYTES}, once each" in TEXT
