"""Rates and modes: what set_rate and set_mode change in the stream."""

from __future__ import annotations

from ribbonhost.wire import Mode, Orient, OrientCompact, Raw

from ribbonhil.conformance.check import Group, expect
from ribbonhil.conformance.checks.recordings import CLOCK_MODULUS, RATE_HZ, RECORD_S, rises, watch
from ribbonhil.conformance.checks.stream import SEQUENCE_MODULUS, SPACING_TOLERANCE_S, periods, scans, steps
from ribbonhil.conformance.device import Device

GROUP = Group("modes")

RATES_HZ = (1, 50, 100, 200)
RATE_TOLERANCE_RATIO = 0.001
SCAN_PACKETS = (Orient, OrientCompact, Raw)
CHANGES = 12
MODE_S = 0.3


@GROUP.check("COMMAND")
def rates_are_kept(device: Device) -> None:
    """At 1, 50, 100 and 200 Hz scans follow each other at that rate of the device's clock, within 0.1 %."""
    for rate_hz in (rate for rate in RATES_HZ if rate <= device.info.rate_max_hz):
        duration_s = RECORD_S if rate_hz == RATE_HZ else max(0.5, 3.2 / rate_hz)
        mode = Mode.ORIENT | Mode.RAW if rate_hz == RATE_HZ else Mode.ORIENT
        recording = device.record(rate_hz, mode, duration_s)
        found = scans(recording, Orient)
        took_us = sum(step_us for _, _, step_us in steps(found))
        count = sum(periods(step_us, rate_hz) for _, _, step_us in steps(found))
        expected_us = count * 1e6 / rate_hz
        expect(
            abs(took_us - expected_us) <= RATE_TOLERANCE_RATIO * expected_us + SPACING_TOLERANCE_S * 1e6,
            f"{count} scans at {rate_hz} Hz in {expected_us:.0f} us",
            f"{took_us} us",
            found[-1][0],
        )
        left_out = count - sum(rise for _, rise, _ in steps(found))
        overruns = rises(recording, "overruns")
        expect(left_out <= overruns, f"at most {overruns} of {count} left out at {rate_hz} Hz", left_out)


@GROUP.check("COMMAND")
def modes_send_what_they_say(device: Device) -> None:
    """After set_mode the packets of that mode follow each scan, and no others."""
    flags = {Orient: Mode.ORIENT, OrientCompact: Mode.ORIENT_COMPACT, Raw: Mode.RAW}
    for mode in (
        Mode(0),
        Mode.ORIENT,
        Mode.ORIENT_COMPACT,
        Mode.RAW,
        Mode.ORIENT | Mode.RAW,
        Mode.ORIENT_COMPACT | Mode.RAW,
    ):
        recording = watch(device, mode, MODE_S)
        for kind, flag in flags.items():
            found = [frame for frame in recording.frames if isinstance(frame.packet, kind)]
            what = f"mode {int(mode)}: {'' if flag in mode else 'no '}{kind.__name__}"
            expect(bool(found) == (flag in mode), what, f"{len(found)}", *found[:1])


@GROUP.check("COMMAND")
def mode_changes_keep_the_stream_whole(device: Device) -> None:
    """Changes of mode and rate in mid-stream spoil no frame, and sequence goes on over them."""
    rates_hz = [rate for rate in (100, 200, 50) if rate <= device.info.rate_max_hz] or [1]
    modes = (Mode.ORIENT, Mode.RAW, Mode.ORIENT | Mode.RAW)
    _, before = device.get_status()
    since = device.mark()
    for step in range(CHANGES):
        device.set(rates_hz[step % len(rates_hz)], modes[step % len(modes)])
        device.receive(0.03)
    device.quiet()
    _, after = device.get_status()
    # Between two modes a scan may pass whose packets neither asks for.
    may_miss = CHANGES + (after.frames_dropped - before.frames_dropped) % CLOCK_MODULUS
    last: int | None = None
    missing = 0
    for frame in device.log[since:]:
        whole = bool(frame.content) and not (frame.is_known and frame.packet is None)
        expect(whole, "frames that decode", frame.problem, frame)
        if isinstance(frame.packet, SCAN_PACKETS):
            sequence = int(frame.packet.sequence)
            missing += 0 if last is None else max(0, (sequence - last) % SEQUENCE_MODULUS - 1)
            expect(missing <= may_miss, "sequence to go on", f"from {last} to {sequence}", frame)
            last = sequence
    expect(last is not None, "scans", "none")
