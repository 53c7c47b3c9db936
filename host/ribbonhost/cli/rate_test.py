"""`ribbonhost rate-test`: how much a ribbon and its link carry without loss."""

import json
import sys
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

from rich.console import Console
from rich.progress import track
from rich.text import Text

from ribbonhost import wire
from ribbonhost.cli.info import status_of
from ribbonhost.cli.naming import open_named
from ribbonhost.cli.printing import plain_table, print_table
from ribbonhost.device import Device
from ribbonhost.errors import UsageError
from ribbonhost.link import BAUD, EMULATOR_SCHEME

RATES_HZ = (50, 100, 150, 200)
MODES = {
    "orient": wire.Mode.ORIENT,
    "compact": wire.Mode.ORIENT_COMPACT,
    "raw": wire.Mode.RAW,
    "both": wire.Mode.ORIENT | wire.Mode.RAW,
}
SETTLE_S = 0.15
"""The first scans after a change are not counted: parts are told of the rate, and queues fill."""

BITS_PER_BYTE = 10
"""On a serial line: a start bit, eight bits, a stop bit."""


@dataclass(frozen=True)
class RateResult:
    """What came at one rate in one mode.

    Attributes:
        frames_per_s, expected_per_s: frames received, and scans times kinds of frame.
        lost: frames missing by the gaps in their sequence.
        dropped: frames that the device gave up because the link is slower than they came.
        overruns: scans that the device left out because the one before took too long.
        crc_errors: frames that came with a wrong checksum.
        bytes_per_s: all bytes received.
        link_percent: of what the link carries; None where that is not known.
        is_clean: whether nothing was lost.
    """

    rate_hz: int
    mode: str
    frames_per_s: float
    expected_per_s: int
    lost: int
    dropped: int
    overruns: int
    crc_errors: int
    bytes_per_s: float
    link_percent: float | None
    is_clean: bool


class FrameCounter:
    """An Observer that counts frames and the gaps between them, each kind for itself."""

    def __init__(self) -> None:
        self.order = threading.Lock()
        self.crc_errors = 0
        self.restart()

    def restart(self) -> None:
        """Forgets frames and gaps; `crc_errors` counts on."""
        self.frames = 0
        self.gaps = 0
        self._sequence: dict[type, int] = {}

    def received(self, packet: bytes, t_host_s: float) -> None:
        try:
            frame, _ = wire.decode(packet)
        except wire.WireError:
            return  # the device counts it
        if isinstance(frame, wire.Orient | wire.OrientCompact | wire.Raw):
            self.frames += 1
            if (before := self._sequence.get(type(frame))) is not None:
                self.gaps += max(0, (frame.sequence - before) % (1 << 16) - 1)
            self._sequence[type(frame)] = frame.sequence

    def sent(self, packet: bytes, t_host_s: float) -> None:
        pass

    def spoiled(self, crc_errors: int, malformed: int, t_host_s: float) -> None:
        self.crc_errors = crc_errors

    def lost(self, why: str, t_host_s: float) -> None:
        pass

    def back(self, port: str, t_host_s: float) -> None:
        pass


def run_rate_test(
    name: str, rates: str | None, seconds: float, *, comb: Path | None, baud: int, as_json: bool
) -> None:
    """Tries all rates in all modes and prints what came. Raises UsageError, LinkError and DeviceError."""
    if not 0.2 <= seconds <= 600:
        raise UsageError(f"--seconds {seconds:g} is not between 0.2 and 600")
    wanted_hz = _rates(rates)
    counter = FrameCounter()
    device = open_named(name, baud=baud, comb=comb, observer=counter)
    try:
        results = _measure_all(device, counter, wanted_hz, seconds, _capacity(device.name, baud))
    finally:
        device.close()
    best = {mode: _highest(results, mode) for mode in MODES}
    if as_json:
        facts = {
            "serial": device.serial,
            "port": device.name,
            "results": [asdict(result) for result in results],
            "highest_clean_rate_hz": best,
        }
        print(json.dumps({"rate_test": facts}))
    else:
        _print(results, best)


def _measure_all(
    device: Device, counter: FrameCounter, wanted_hz: list[int], seconds: float, capacity: float | None
) -> list[RateResult]:
    """Leaves the device with the rate and mode that it had."""
    info = device.info
    assert info is not None  # a device that was opened has answered
    possible_hz = [rate for rate in wanted_hz if rate <= info.rate_max_hz] or [info.rate_max_hz]
    cases = [(rate, mode) for mode in MODES for rate in possible_hz]
    steps = track(
        cases,
        "Trying rates and modes",
        console=Console(stderr=True),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    try:
        return [_measure(device, counter, rate, mode, seconds, capacity) for rate, mode in steps]
    finally:
        device.command(wire.CommandCode.SET_MODE, 0)
        device.command(wire.CommandCode.SET_RATE, info.rate_hz)
        device.command(wire.CommandCode.SET_MODE, info.mode)


def _measure(
    device: Device, counter: FrameCounter, rate_hz: int, mode: str, seconds: float, capacity: float | None
) -> RateResult:
    device.command(wire.CommandCode.SET_MODE, 0)
    device.command(wire.CommandCode.SET_RATE, rate_hz)
    before = status_of(device)
    device.command(wire.CommandCode.SET_MODE, MODES[mode])
    time.sleep(SETTLE_S)
    with counter.order:
        counter.restart()
        spoiled_before = counter.crc_errors
    bytes_before, start_s = device.link.bytes_read, time.monotonic()
    time.sleep(seconds)
    with counter.order:
        frames, lost, crc_errors = counter.frames, counter.gaps, counter.crc_errors - spoiled_before
    received, elapsed_s = device.link.bytes_read - bytes_before, time.monotonic() - start_s
    device.command(wire.CommandCode.SET_MODE, 0)
    after = status_of(device)
    dropped = (after.frames_dropped - before.frames_dropped) % (1 << 32)
    overruns = (after.overruns - before.overruns) % (1 << 32)
    expected_per_s = rate_hz * MODES[mode].bit_count()
    is_complete = frames >= 0.95 * expected_per_s * elapsed_s - 2 * MODES[mode].bit_count()
    return RateResult(
        rate_hz=rate_hz,
        mode=mode,
        frames_per_s=round(frames / elapsed_s, 1),
        expected_per_s=expected_per_s,
        lost=lost,
        dropped=dropped,
        overruns=overruns,
        crc_errors=crc_errors,
        bytes_per_s=round(received / elapsed_s),
        link_percent=None if capacity is None else round(100 * received / elapsed_s / capacity, 1),
        is_clean=is_complete and not (lost or dropped or overruns or crc_errors),
    )


def _highest(results: list[RateResult], mode: str) -> int | None:
    """The highest rate up to which nothing was lost; None if even the lowest lost something."""
    highest = None
    for result in sorted((r for r in results if r.mode == mode), key=lambda r: r.rate_hz):
        if not result.is_clean:
            break
        highest = result.rate_hz
    return highest


def _capacity(url: str, baud: int) -> float | None:
    """Bytes a second that the link carries; None where a speed in bits says nothing."""
    if url.startswith(EMULATOR_SCHEME):
        baud = int(parse_qs(urlsplit(url).query).get("baud", [str(BAUD)])[0])
    elif "://" in url:
        return None
    return baud / BITS_PER_BYTE


def _rates(text: str | None) -> list[int]:
    if text is None:
        return list(RATES_HZ)
    try:
        rates_hz = sorted({int(word) for word in text.split(",")})
    except ValueError:
        rates_hz = [0]
    low, high = wire.INFO_RATE_MAX_HZ_RANGE
    if not all(low <= rate <= high for rate in rates_hz):
        raise UsageError(f"--rates {text} must be numbers from {low} to {high} with commas: --rates 50,100")
    return rates_hz


def _print(results: list[RateResult], best: dict[str, int | None]) -> None:
    table = plain_table("mode", "rate Hz", "frames/s", "lost", "dropped", "overruns", "CRC errors", "bytes/s")
    table.add_column("link %")
    for column in table.columns[1:]:
        column.justify = "right"
    for result in results:
        table.add_row(
            result.mode,
            str(result.rate_hz),
            f"{result.frames_per_s:.1f}",
            *(
                Text(str(count), "red" if count else "")
                for count in (result.lost, result.dropped, result.overruns, result.crc_errors)
            ),
            f"{result.bytes_per_s:.0f}",
            "" if result.link_percent is None else f"{result.link_percent:.1f}",
        )
    print_table(table)
    words = (f"{mode} {f'{rate} Hz' if rate else 'none'}" for mode, rate in best.items())
    print(f"Highest rate that loses nothing: {', '.join(words)}.")
