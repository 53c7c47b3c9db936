"""Whatever bytes arrive: no exception, and every intact frame is used or counted."""

from collections.abc import Iterator

import pytest
from host.fake_ribbon import FakeRibbon, frame_of, info_packet, orient_packet, status_packet
from hypothesis import given, settings
from hypothesis import strategies as st
from ribbonhost import wire
from ribbonhost.device import Device
from ribbonhost.framing import encode_frame
from ribbonhost.link import Link


@pytest.fixture(scope="module")
def device() -> Iterator[Device]:
    device = Device(Link(FakeRibbon(), "fake"))
    device.handshake()
    yield device
    device.close()


u8, u16, u32 = (st.integers(0, (1 << bits) - 1) for bits in (8, 16, 32))
packets = st.one_of(
    st.builds(orient_packet, u32, u16, st.integers(0, wire.NODE_MAX)).map(wire.encode),
    st.builds(wire.Ack, u16, u8, u8, u32, st.binary(max_size=192)).map(wire.encode),
    st.builds(wire.ClockPong, u16, u32, u32, u32).map(wire.encode),
    st.builds(
        lambda version, pitch_m, nodes, rate_hz: wire.encode(
            info_packet(wire_version=version, pitch_m=pitch_m, node_count=nodes, rate_hz=rate_hz)
        ),
        st.integers(0, 255), st.floats(width=32), st.integers(0, 255), u16,
    ),
    st.just(wire.encode(status_packet())),
    st.builds(lambda kind, rest: bytes([kind]) + rest, st.integers(0, 255), st.binary(max_size=300)),
)  # fmt: skip
pieces = st.one_of(
    packets.map(encode_frame),
    packets.map(encode_frame).flatmap(lambda frame: st.integers(0, len(frame)).map(lambda end: frame[:end])),
    st.binary(max_size=100),
)


@settings(max_examples=150, deadline=None)
@given(stream=st.lists(pieces, max_size=12).map(b"".join), cuts=st.lists(st.integers(1, 300), max_size=20))
def test_no_bytes_raise_and_the_next_frame_is_understood(
    device: Device, stream: bytes, cuts: list[int]
) -> None:
    for cut in cuts:
        device._on_bytes(stream[:cut], 1000.0)
        stream = stream[cut:]
    device._on_bytes(stream + b"\x00", 1000.0)
    before = device.counters().unknown_packets
    device._on_bytes(encode_frame(b"\xfe"), 1000.0)
    assert device.counters().unknown_packets == before + 1


@settings(max_examples=50, deadline=None)
@given(frames=st.lists(st.tuples(u32, u16, st.integers(0, 6)), max_size=30))
def test_every_intact_scan_is_used_or_counted(device: Device, frames: list[tuple[int, int, int]]) -> None:
    device.clock.restart()
    device._scans.restart()
    device._on_bytes(frame_of(info_packet()), 1000.0)
    device.clock.add_exchange(1000.0, 0, 0, 1000.0)
    before = device.counters()
    for t_us, sequence, nodes in frames:
        device._on_bytes(frame_of(orient_packet(t_us, sequence, nodes)), 1000.0)
    new = device.counters() - before
    assert new.frames + new.wrong_node_count + new.clock_jumps + new.repeated == len(frames)
    assert new.lost >= 0
