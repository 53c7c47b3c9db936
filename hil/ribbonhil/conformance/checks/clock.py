"""The device's clock, as CLOCK_PING and the time stamps show it."""

from __future__ import annotations

from ribbonhost.wire import ClockPing, ClockPong, Mode, Orient, encode

from ribbonhil.conformance.check import BrokenRuleError, Group, expect
from ribbonhil.conformance.checks.recordings import CLOCK_MODULUS, RATE_HZ
from ribbonhil.conformance.client import PATIENCE_S, Frame
from ribbonhil.conformance.device import Device

GROUP = Group("clock")

RATE_TOLERANCE_RATIO = 0.02
RATE_WINDOW_S = 2.0
# How long a device may hold a pong back: it answers at once, a scan of all slots may be under way.
HOLD_LIMIT_US = 100_000


def forward_us(earlier_us: int, later_us: int) -> int:
    """From one device time to another, negative if it went back; right over a wrap."""
    difference_us = (later_us - earlier_us) % CLOCK_MODULUS
    return difference_us - CLOCK_MODULUS if difference_us >= CLOCK_MODULUS // 2 else difference_us


def ping(device: Device, t_host_us: int = 0, tag: int | None = None) -> tuple[float, Frame, ClockPong]:
    """(host time of sending, frame, pong). Raises BrokenRuleError if none comes."""
    tag = device.next_tag() if tag is None else tag
    since = device.mark()
    sent_s = device.now_s()
    packet = encode(ClockPing(tag=tag, t_host_us=t_host_us))
    device.send(packet)
    frame = device.wait_for(lambda f: isinstance(f.packet, ClockPong), since, PATIENCE_S)
    if frame is None:
        raise BrokenRuleError("a CLOCK_PONG for a CLOCK_PING", f"none in {PATIENCE_S:g} s", packet)
    assert isinstance(frame.packet, ClockPong)
    return sent_s, frame, frame.packet


@GROUP.check("CLOCK_PING")
def pong_echoes_the_ping(device: Device) -> None:
    """A CLOCK_PONG brings tag and t_host_us of its CLOCK_PING back, all bits of them."""
    for tag, t_host_us in ((0, 0), (0xFFFF, 2**64 - 1), (0x1234, 0x0123456789ABCDEF)):
        _, frame, pong = ping(device, t_host_us, tag)
        expect(pong.tag == tag, f"tag {tag}", pong.tag, frame)
        expect(pong.t_host_us == t_host_us, f"t_host_us {t_host_us}", pong.t_host_us, frame)


@GROUP.check("CLOCK_PING")
def each_ping_has_one_pong(device: Device) -> None:
    """Pings sent together are each answered once, in their order."""
    tags = [device.next_tag() for _ in range(5)]
    since = device.mark()
    for tag in tags:
        device.send(encode(ClockPing(tag=tag, t_host_us=tag)))
    device.wait_for(lambda f: isinstance(f.packet, ClockPong) and f.packet.tag == tags[-1], since, PATIENCE_S)
    device.receive(0.05)
    seen = [f.packet.tag for f in device.log[since:] if isinstance(f.packet, ClockPong)]
    expect(seen == tags, f"pongs with tags {tags}", seen)


@GROUP.check("CLOCK_PING")
def pong_times_are_in_order(device: Device) -> None:
    """t_receive_us is not after t_transmit_us, and not longer before it than a scan takes."""
    device.set(device.info.rate_max_hz, Mode.ORIENT | Mode.RAW)
    for _ in range(20):
        _, frame, pong = ping(device)
        held_us = forward_us(pong.t_receive_us, pong.t_transmit_us)
        expect(
            0 <= held_us <= HOLD_LIMIT_US, f"0 to {HOLD_LIMIT_US} us from receive to transmit", held_us, frame
        )


@GROUP.check("CLOCK_PING")
def clock_never_goes_back(device: Device) -> None:
    """The device's time rises from ping to ping, modulo 2^32."""
    _, _, last = ping(device)
    for _ in range(20):
        _, frame, pong = ping(device)
        rise_us = forward_us(last.t_transmit_us, pong.t_receive_us)
        expect(rise_us >= 0, "a later time", f"{rise_us} us later", frame)
        last = pong


@GROUP.check("CLOCK_PING")
def clock_keeps_time(device: Device) -> None:
    """The device's clock runs as fast as the host's, within 2 %."""
    first_sent_s, first_frame, first = ping(device)
    device.receive(RATE_WINDOW_S)
    last_sent_s, last_frame, last = ping(device)
    took_s = forward_us(first.t_receive_us, last.t_receive_us) / 1e6
    # A ping was received some time between its sending and its pong.
    slowest = took_s / (last_frame.t_host_s - first_sent_s)
    fastest = took_s / (last_sent_s - first_frame.t_host_s)
    expect(
        slowest <= 1.0 + RATE_TOLERANCE_RATIO and fastest >= 1.0 - RATE_TOLERANCE_RATIO,
        "1 s a second, within 2 %",
        f"{slowest:.4f} to {fastest:.4f} s",
        last_frame,
    )


@GROUP.check("ORIENT")
def scans_and_pongs_share_a_clock(device: Device) -> None:
    """t_us of scans passes the time of a pong that came before, and is never after one that comes later."""
    rate_hz = min(RATE_HZ, device.info.rate_max_hz)
    device.set(rate_hz, Mode.ORIENT)
    _, _, before = ping(device)
    since = device.mark()
    orient = wait_for_scan(device, since, before.t_transmit_us)
    expect(orient is not None, f"an ORIENT after {before.t_transmit_us} us, the time of a pong", "none")
    _, pong, after = ping(device)
    for frame in device.log[since:]:
        if frame is pong:
            break
        if isinstance(frame.packet, Orient):
            ahead_us = forward_us(after.t_receive_us, frame.packet.t_us)
            expect(ahead_us <= 0, "no t_us after a pong that came later", f"{ahead_us} us after", frame)


@GROUP.check("CLOCK_PING")
def status_and_pongs_share_a_clock(device: Device) -> None:
    """t_us of a STATUS that was asked for lies between the pongs before and after it."""
    _, _, before = ping(device)
    frame, status = device.get_status()
    _, _, after = ping(device)
    span_us = forward_us(before.t_receive_us, after.t_transmit_us)
    since_us = forward_us(before.t_receive_us, status.t_us)
    expect(0 <= since_us <= span_us, f"0 to {span_us} us after the pong before", f"{since_us} us", frame)


def wait_for_scan(device: Device, since: int, after_us: int) -> Orient | None:
    """An ORIENT whose scan ended after a device time, None if none comes in time."""
    patience_s = PATIENCE_S + 5.0 / device.info.rate_max_hz

    def wanted(frame: Frame) -> bool:
        return isinstance(frame.packet, Orient) and forward_us(after_us, frame.packet.t_us) > 0

    frame = device.wait_for(wanted, since, patience_s)
    return frame.packet if frame and isinstance(frame.packet, Orient) else None
