"""How evenly scans follow each other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from ribbonhil.check.bench import Bench
from ribbonhil.check.check import Measurement, Topic

TOPIC = Topic("jitter")

JITTER_MAX_US = 500.0
JITTER_MAX_RATIO = 0.02
"""The larger of the two is what the protocol's conformance allows a single scan ..."""
JITTER_P99_SHARE = 0.5
"""... and 99 of 100 are within this share of it."""


@TOPIC.check
def scan_intervals(bench: Bench) -> Iterator[Measurement]:
    """Scans are a period apart by the device's clock: what it does besides (bring-up, flash, commands) must
    not delay them. A sensor that is read late is read wrong while the ribbon moves. How late packets arrive
    is told and not judged: it is a matter of the cable and of this computer."""
    for rate_hz in bench.rates_hz:
        scans = bench.scans(rate_hz)
        period_us = 1e6 / rate_hz
        steps = np.maximum(1, np.round(np.diff(scans.t_us) / period_us))
        off_us = np.abs(np.diff(scans.t_us) - steps * period_us)
        limit_us = max(JITTER_MAX_US, JITTER_MAX_RATIO * period_us)
        yield Measurement(
            f"interval off by, p99 at {rate_hz} Hz",
            float(np.percentile(off_us, 99)),
            "us",
            high=JITTER_P99_SHARE * limit_us,
        )
        yield Measurement(
            f"interval off by, largest at {rate_hz} Hz", float(off_us.max()), "us", high=limit_us
        )

        late_s = scans.arrival_s - scans.t_us * 1e-6
        late_ms = 1e3 * (late_s - late_s.min())
        yield Measurement(f"arrival late, p99 at {rate_hz} Hz", float(np.percentile(late_ms, 99)), "ms")
        yield Measurement(
            f"arrival late, largest at {rate_hz} Hz", float(late_ms.max()), "ms", where="behind the fastest"
        )
