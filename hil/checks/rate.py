"""Whether the device scans as often as it was told to, by its own clock and by this computer's."""

from __future__ import annotations

from collections.abc import Iterator

from ribbonhil.check.bench import Bench
from ribbonhil.check.check import Measurement, NotRunError, Topic
from ribbonhost.clock import DeviceClock
from ribbonhost.wire import CommandCode

TOPIC = Topic("rate")

RATE_TOLERANCE = 0.5e-3
"""Scans are whole periods apart by the device's clock: only rounding and the first and last scan are left."""
CLOCK_PPM = 200.0
"""A crystal and this computer's are each wrong by tens; an internal oscillator by thousands."""
EXCHANGES_MIN = 10


@TOPIC.check
def scans_a_second(bench: Bench) -> Iterator[Measurement]:
    """The rate asked for is the rate in use, and the scans are so many a second by the device's own clock: a
    wrong timer setting, or a scan that takes too long, shows here."""
    for rate_hz in bench.rates_hz:
        scans = bench.scans(rate_hz)
        number = scans.number - scans.number.mean()
        slope = float(number @ (scans.t_us - scans.t_us[0]))
        measured_hz = 1e6 * float(number @ number) / slope if slope > 0 else float("nan")
        yield Measurement(
            f"scans a second at {rate_hz} Hz",
            measured_hz,
            "Hz",
            low=rate_hz * (1 - RATE_TOLERANCE),
            high=rate_hz * (1 + RATE_TOLERANCE),
        )
    told = bench.device.accepted(CommandCode.SET_RATE, rate_hz).ack.value
    yield Measurement(f"rate told for {rate_hz} Hz", told, "Hz", low=rate_hz, high=rate_hz)


@TOPIC.check
def clock_of_the_device(bench: Bench) -> Iterator[Measurement]:
    """The device's clock runs as fast as this computer's, by pings all through the recordings: times of
    several ribbons are put together by it, and a crystal that did not start is off by thousands of ppm."""
    for rate_hz in bench.rates_hz:
        bench.stream(rate_hz)
    exchanges = bench.device.exchanges()
    if len(exchanges) < EXCHANGES_MIN:
        raise NotRunError(f"{len(exchanges)} pings were answered, {EXCHANGES_MIN} are needed")
    clock = DeviceClock()
    for exchange in exchanges:
        clock.add_exchange(*exchange)
    uncertain_ppm = drift_bound_ppm(exchanges)
    limit_ppm = CLOCK_PPM + uncertain_ppm
    yield Measurement(
        "device clock fast by",
        -clock.drift_ppm,
        "ppm",
        low=-limit_ppm,
        high=limit_ppm,
        where=f"known to {uncertain_ppm:.0f} ppm",
    )
    yield Measurement("shortest round trip", clock.round_trip_s * 1e3, "ms")


def drift_bound_ppm(exchanges: list[tuple[float, int, int, float]]) -> float:
    """How wrong a drift can be at worst: a ping was received between T1 and T4, nothing else is sure.

    Of the best exchange in the first and in the last third.
    """
    third = max(1, len(exchanges) // 3)

    def best(some: list[tuple[float, int, int, float]]) -> tuple[float, float]:
        """Half of the time on the way, and when."""
        return min(((t4 - t1) - (t3 - t2) * 1e-6, t1) for t1, t2, t3, t4 in some)

    (early_s, from_s), (late_s, to_s) = best(exchanges[:third]), best(exchanges[-third:])
    return (early_s + late_s) / 2 / max(to_s - from_s, 1e-3) * 1e6
