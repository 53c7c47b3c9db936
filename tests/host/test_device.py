"""A device is asked who it is, told what to do, and believed only what can be."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import numpy as np
import pytest
from host.fake_ribbon import NODES, FakeRibbon, frame_of, info_packet, orient_packet
from ribbonhost import wire
from ribbonhost.device import Counters, Device, Scan
from ribbonhost.errors import (
    CommandRefusedError,
    CommandTimeoutError,
    DeviceError,
    LinkLostError,
    NoAnswerError,
    WireVersionError,
)
from ribbonhost.framing import encode_frame
from ribbonhost.link import Link

Opened = Callable[[FakeRibbon], AbstractContextManager[Device]]


@contextmanager
def opened(ribbon: FakeRibbon) -> Iterator[Device]:
    device = Device(Link(ribbon, "fake"))
    try:
        yield device
    finally:
        device.close()
        assert ribbon.closed


@contextmanager
def fed(**info_changes: object) -> Iterator[tuple[Device, Callable[[bytes], None], list[Scan]]]:
    """A device after its handshake, its clock known; what feeds it bytes; and the scans that it passed on."""
    with opened(FakeRibbon(info_changes=info_changes)) as device:
        device.handshake()
        device.clock.add_exchange(1000.0, 0, 0, 1000.0)
        scans: list[Scan] = []
        device.on_scan = scans.append

        def feed(data: bytes, t_host_s: float = 1000.5) -> None:
            device._on_bytes(data, t_host_s)

        yield device, feed, scans


def orient(sequence: int, t_us: int | None = None, **changes: object) -> bytes:
    """The frame of a scan that ended when one of this number would, 100 times a second."""
    t_us = sequence * 10_000 if t_us is None else t_us
    return frame_of(orient_packet(t_us, sequence, **changes))  # type: ignore[arg-type]


def wait_for(condition: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + 5
    while not condition():
        assert time.monotonic() < deadline_s, "did not come true in 5 s"
        time.sleep(0.005)


# ---- handshake


def test_the_handshake_tells_who_the_device_is_even_while_it_streams() -> None:
    ribbon = FakeRibbon(serial="0123456789abcdef01234567")
    ribbon.mode = wire.Mode.ORIENT
    ribbon.send(b"\x07half a frame from before\x00" + orient(3)[4:])
    with opened(ribbon) as device:
        info = device.handshake()
        assert device.serial == "0123456789abcdef01234567"
        assert info.node_count == NODES
        assert device.same_schema


def test_an_answer_that_is_lost_is_asked_for_again() -> None:
    ribbon = FakeRibbon()
    lost = iter([True, True])
    ribbon.spoil = lambda frame: b"" if next(lost, False) else frame
    with opened(ribbon) as device:
        device.handshake()
    assert len(ribbon.commands) == 2


def test_a_device_that_never_answers_is_an_error_that_says_what_was_tried() -> None:
    with (
        opened(FakeRibbon(deaf=True)) as device,
        pytest.raises(NoAnswerError, match=r"fake was asked \d+ times in 0.6 s who it is and sent nothing"),
    ):
        device.handshake(timeout_s=0.6)


def test_noise_is_told_apart_from_silence() -> None:
    ribbon = FakeRibbon(deaf=True)
    ribbon.send(np.random.default_rng(5).bytes(3000))
    with (
        opened(ribbon) as device,
        pytest.raises(
            NoAnswerError, match=r"sent 3000 bytes but no packet \(\d+ CRC errors, \d+ malformed\).*--baud"
        ),
    ):
        device.handshake(timeout_s=0.3)


def test_a_device_that_only_talks_is_told_apart_from_noise() -> None:
    ribbon = FakeRibbon(deaf=True)
    ribbon.mode = wire.Mode.ORIENT
    with (
        opened(ribbon) as device,
        pytest.raises(NoAnswerError, match=r"sent \d+ packets but never INFO \(0 CRC errors\)"),
    ):
        device.handshake(timeout_s=0.3)


def test_a_device_that_needs_a_later_host_says_which() -> None:
    with (
        opened(FakeRibbon(info_changes={"wire_version": 9, "oldest_host_version": 7})) as device,
        pytest.raises(
            WireVersionError, match="wire version 9 and needs a host that speaks at least 7; this one speaks"
        ),
    ):
        device.handshake()


def test_a_later_info_that_cannot_even_be_read_still_tells_its_version() -> None:
    ribbon = FakeRibbon(deaf=True)
    with opened(ribbon) as device:
        ribbon.send(encode_frame(bytes([wire.PacketId.INFO, 9, 7, 1, 2, 3])))
        with pytest.raises(WireVersionError, match="at least 7"):
            device.handshake()


def test_another_schema_of_a_compatible_version_works_and_is_noted() -> None:
    changes = {"wire_version": 2, "oldest_host_version": 1, "schema_hash": 0x12345678}
    ribbon = FakeRibbon(info_changes=changes)
    ribbon.spoil = lambda frame: frame
    with opened(ribbon) as device:
        device.handshake()
        assert not device.same_schema
        ribbon.send(encode_frame(wire.encode(info_packet(**changes)) + b"appended"))
        ribbon.send(encode_frame(b"\x7fanother packet"))
        wait_for(lambda: device.counters().unknown_packets == 1)
        assert device.counters().surplus_bytes == 8
        assert device.counters().crc_errors == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pitch_m": float("nan")}, "a pitch of nan m"),
        ({"pitch_m": -0.025}, "a pitch of -0.025 m"),
        ({"node_count": 0}, "0 nodes on 8 slots"),
        ({"node_count": 5}, "5 nodes on 8 slots"),
        ({"rate_hz": 0}, "a rate of 0 Hz"),
        ({"rate_hz": 200, "rate_max_hz": 100}, "a rate of 200 Hz where at most 100"),
    ],
)
def test_an_info_that_cannot_be_is_refused(changes: dict[str, object], message: str) -> None:
    with opened(FakeRibbon(info_changes=changes)) as device, pytest.raises(DeviceError, match=message):
        device.handshake()


def test_a_device_that_vanishes_in_the_handshake_is_noticed_at_once() -> None:
    ribbon = FakeRibbon(deaf=True)
    with opened(ribbon) as device:
        threading.Timer(0.1, ribbon.vanish).start()
        start_s = time.monotonic()
        with pytest.raises(LinkLostError, match="fake vanished"):
            device.handshake(timeout_s=30)
        assert time.monotonic() - start_s < 5


# ---- commands


def test_a_command_is_acknowledged_and_its_effect_known() -> None:
    with opened(FakeRibbon()) as device:
        device.handshake()
        assert device.command(wire.CommandCode.SET_RATE, 50).value == 50
        assert device.rate_hz == 50


def test_a_command_is_repeated_until_it_is_acknowledged() -> None:
    ribbon = FakeRibbon()
    with opened(ribbon) as device:
        device.handshake()
        lost = iter([True])
        ribbon.spoil = lambda frame: b"" if next(lost, False) else frame
        device.command(wire.CommandCode.IDENTIFY, 100)
    assert ribbon.commands.count((wire.CommandCode.IDENTIFY, 100)) == 2


def test_a_command_that_is_never_acknowledged_times_out() -> None:
    ribbon = FakeRibbon()
    with opened(ribbon) as device:
        device.handshake()
        ribbon.deaf = True
        with pytest.raises(CommandTimeoutError, match=r"did not acknowledge set_rate within 0\.3 s"):
            device.command(wire.CommandCode.SET_RATE, 50, timeout_s=0.3)


@pytest.mark.parametrize(("code", "text"), [(wire.AckCode.UNSUPPORTED, "unsupported"), (99, "code 99")])
def test_a_refused_command_says_why(code: int, text: str) -> None:
    with opened(FakeRibbon(refused={wire.CommandCode.SET_PHASE: code})) as device:
        device.handshake()
        with pytest.raises(CommandRefusedError, match=f"refused set_phase 7: {text}") as error:
            device.command(wire.CommandCode.SET_PHASE, 7)
        assert error.value.code == code


def test_an_acknowledgement_of_something_else_is_counted_not_taken() -> None:
    ribbon = FakeRibbon()
    with opened(ribbon) as device:
        device.handshake()
        ribbon.deaf = True
        for tag in range(0, 1 << 16, 997):
            ribbon.send(frame_of(wire.Ack(tag, wire.CommandCode.SET_RATE, wire.AckCode.OK, 7, b"")))
        ribbon.send(frame_of(wire.ClockPong(1, 2, 3, 4)))
        wait_for(lambda: device.counters().unexpected == len(range(0, 1 << 16, 997)) + 1)
        assert device.rate_hz == 100


def test_a_command_ends_at_once_when_the_device_vanishes() -> None:
    ribbon = FakeRibbon()
    with opened(ribbon) as device:
        device.handshake()
        ribbon.deaf = True
        threading.Timer(0.1, ribbon.vanish).start()
        start_s = time.monotonic()
        with pytest.raises(LinkLostError):
            device.command(wire.CommandCode.SET_RATE, 50, timeout_s=30)
        assert time.monotonic() - start_s < 5


# ---- scans


def test_scans_are_passed_on_with_host_times() -> None:
    with fed() as (device, feed, scans):
        feed(orient(10) + orient(11, valid=[True, False, True, True]))
        assert [scan.sequence for scan in scans] == [10, 11]
        assert scans[0].t_host_s == pytest.approx(1000.1, abs=1e-6)
        assert scans[1].valid.tolist() == [True, False, True, True]
        assert device.counters() == Counters(frames=2, invalid_nodes=1)


def test_gaps_in_the_sequence_are_lost_frames() -> None:
    with fed() as (device, feed, scans):
        feed(orient(10) + orient(11) + orient(15) + orient(16))
        assert len(scans) == 4
        assert device.counters().lost == 3


def test_the_sequence_and_the_device_clock_wrap_without_a_trace() -> None:
    with fed() as (device, feed, scans):
        device.clock.restart()
        device.clock.add_exchange(1000.0, (1 << 32) - 30_000, (1 << 32) - 30_000, 1000.0)
        for k in range(6):
            feed(orient(65_533 + k, t_us=(1 << 32) - 30_000 + k * 10_000), 1000.0 + k * 0.01)
        assert device.counters() == Counters(frames=6)
        np.testing.assert_allclose(np.diff([scan.t_host_s for scan in scans]), 0.01, atol=1e-6)


def test_corrupt_and_truncated_frames_lose_only_themselves() -> None:
    with fed() as (device, feed, scans):
        broken = bytearray(orient(11))
        broken[20] ^= 0x55
        feed(orient(10) + bytes(broken) + orient(12) + orient(13)[:30] + b"\x00" + orient(14))
        assert [scan.sequence for scan in scans] == [10, 12, 14]
        counters = device.counters()
        assert counters.crc_errors + counters.malformed == 2
        assert counters.lost == 2


def test_another_number_of_nodes_is_counted_and_not_used() -> None:
    with fed() as (device, feed, scans):
        feed(orient(10, nodes=NODES + 1) + orient(11, nodes=0) + orient(12))
        assert [scan.sequence for scan in scans] == [12]
        assert device.counters().wrong_node_count == 2


def test_a_time_that_cannot_be_is_counted_and_harms_no_other_scan() -> None:
    with fed() as (device, feed, scans):
        feed(orient(10))
        feed(orient(11, t_us=3_000_000_000))
        feed(orient(12, t_us=700_000))  # 0.2 s after its own arrival
        feed(orient(13))
        feed(orient(14, t_us=50_000))  # before the one before
        feed(orient(15))
        assert [scan.sequence for scan in scans] == [10, 13, 15]
        assert device.counters().clock_jumps == 3
        assert device.counters().lost == 3


def test_a_sequence_that_jumps_is_no_loss_of_thousands() -> None:
    with fed() as (device, feed, scans):
        feed(orient(10) + orient(40_000, t_us=110_000) + orient(12))
        assert len(scans) == 3
        assert device.counters().sequence_jumps == 2
        assert device.counters().lost == 0


def test_a_repeated_scan_is_counted_once() -> None:
    with fed() as (device, feed, scans):
        feed(orient(10) + orient(10) + orient(11))
        assert [scan.sequence for scan in scans] == [10, 11]
        assert device.counters().repeated == 1


def test_scans_before_the_clock_is_known_are_counted() -> None:
    with fed() as (device, feed, scans):
        device.clock.restart()
        feed(orient(10))
        assert scans == []
        assert device.counters() == Counters(untimed=1)


def test_packets_that_only_a_host_sends_are_counted() -> None:
    with fed() as (device, feed, _):
        feed(frame_of(wire.ClockPing(1, 2)) + encode_frame(b"\xeenew"))
        assert device.counters().unknown_packets == 2


def test_a_device_that_announces_itself_anew_was_reset() -> None:
    with fed() as (device, feed, scans):
        feed(orient(10))
        feed(frame_of(info_packet(rate_hz=50)))
        assert device.restarts == 1
        assert not device.clock.synced
        assert device.rate_hz == 50
        device.clock.add_exchange(1000.0, 0, 0, 1000.0)
        feed(orient(1, t_us=10_000))
        assert device.counters() == Counters(frames=2)
        assert len(scans) == 2


def test_pings_find_the_clock() -> None:
    ribbon = FakeRibbon(clock_offset_us=987_654_321_000, drift_ppm=80)
    with opened(ribbon) as device:
        device.handshake()
        for _ in range(10):
            device.ping()
            time.sleep(0.005)
        wait_for(lambda: device.clock.synced)
        t_host_s, t_device_us = time.monotonic(), ribbon.now_us()
        extended_us = device.clock.extend(t_device_us % (1 << 32), t_host_s)
        assert device.clock.t_host_s(extended_us) == pytest.approx(t_host_s, abs=5e-3)
