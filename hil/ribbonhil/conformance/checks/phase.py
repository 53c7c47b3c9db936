"""set_phase: scans start when the host asks, so that ribbons sample together."""

from __future__ import annotations

from dataclasses import dataclass

from ribbonhost.wire import CommandCode, Mode

from ribbonhil.conformance.check import BrokenRuleError, Group, expect
from ribbonhil.conformance.checks.clock import forward_us, ping, wait_for_scan
from ribbonhil.conformance.checks.recordings import CLOCK_MODULUS, RATE_HZ
from ribbonhil.conformance.client import Reply
from ribbonhil.conformance.device import Device

GROUP = Group("phase")

TOLERANCE_US = 500
# Parts of a period by which scans are asked to move.
MOVES = (0.3, -0.4, 0.1)
PAST_PERIODS = -100
FAR_PERIODS = 100_000


@dataclass(frozen=True)
class Move:
    """What a set_phase did: its ACK, and ends of scans before and after it."""

    reply: Reply
    before_us: int
    after_us: int
    period_us: int

    @property
    def told_us(self) -> int:
        """ACK.value, a signed number."""
        value = self.reply.ack.value
        return value - CLOCK_MODULUS if value >= CLOCK_MODULUS // 2 else value

    @property
    def moved_us(self) -> int:
        """By how much scans moved, but for whole periods."""
        return off_grid_us(forward_us(self.before_us, self.after_us), self.period_us)


def off_grid_us(difference_us: int, period_us: int) -> int:
    """How far a difference of times is from the nearest whole number of periods, signed."""
    return (difference_us + period_us // 2) % period_us - period_us // 2


def scan_end(device: Device, period_us: int) -> int:
    """t_us of a scan that is whole periods from now. Raises BrokenRuleError if none comes."""
    since = device.mark()
    _, _, now = ping(device)
    # The scan after the next is the first that cannot have been under way.
    orient = wait_for_scan(device, since, (now.t_transmit_us + 2 * period_us) % CLOCK_MODULUS)
    if orient is None:
        raise BrokenRuleError(
            f"an ORIENT two periods after {now.t_transmit_us} us, the time of a pong", "none"
        )
    return orient.t_us


def move(device: Device, part: float, ahead_periods: int) -> Move:
    """Asks for scans `part` of a period later, by a time `ahead_periods` from now, negative in the past."""
    period_us = round(1e6 / min(RATE_HZ, device.info.rate_max_hz))
    device.accepted(CommandCode.SET_MODE, Mode.ORIENT)
    before_us = scan_end(device, period_us)
    _, status = device.get_status()
    wanted_us = (before_us - status.scan_us + round((ahead_periods + part) * period_us)) % CLOCK_MODULUS
    reply = device.accepted(CommandCode.SET_PHASE, wanted_us)
    after_us = scan_end(device, period_us)
    frame, status = device.get_status()
    off_us = off_grid_us(forward_us(wanted_us, after_us - status.scan_us), period_us)
    expect(
        abs(off_us) <= TOLERANCE_US,
        f"scans to start whole periods of {period_us} us from {wanted_us} us, within {TOLERANCE_US} us",
        f"{off_us} us beside",
        reply.frame,
        frame,
    )
    return Move(reply, before_us, after_us, period_us)


def start(device: Device) -> None:
    device.accepted(CommandCode.SET_RATE, min(RATE_HZ, device.info.rate_max_hz))


@GROUP.check("COMMAND")
def scans_start_when_asked(device: Device) -> None:
    """After set_phase a scan starts whole periods from the time asked for: t_us - scan_us, within 0.5 ms."""
    start(device)
    for part in MOVES:
        move(device, part, 5)


@GROUP.check("COMMAND")
def any_phase_is_taken(device: Device) -> None:
    """set_phase takes times in the past and far ahead alike."""
    start(device)
    for ahead_periods in (PAST_PERIODS, FAR_PERIODS):
        move(device, 0.25, ahead_periods)


@GROUP.check("COMMAND")
def phase_tells_the_move(device: Device) -> None:
    """ACK.value of set_phase is by how much scans moved, signed, at most half a period."""
    start(device)
    for part in MOVES:
        done = move(device, part, 5)
        expect(
            abs(done.told_us) <= done.period_us // 2 + 1,
            f"at most half of {done.period_us} us",
            f"{done.told_us} us",
            done.reply.frame,
        )
        expect(
            abs(off_grid_us(done.moved_us - done.told_us, done.period_us)) <= TOLERANCE_US,
            f"ACK.value {done.moved_us} us, by which scans moved, within {TOLERANCE_US} us",
            f"{done.told_us} us",
            done.reply.frame,
        )
