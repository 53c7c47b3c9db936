"""Readings of ribbons as samples for the motion estimator: which serve, when it must begin anew."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ribbonhost import wire
from ribbonhost.device import Scan
from ribbonhost.motion import LiveMotion, MotionParams, Samples
from ribbonhost.motion.scans import Sampler, Timing, params_of
from ribbonhost.pipeline.arrangement import Arrangement, Place
from ribbonhost.reconstruct import CombLayout

PREDICTED_S = 0.1
"""For so long after the last readings the estimate is carried on without; then the level reading serves."""

Calibrations = Mapping[str, wire.Calibration]
"""Calibration records by serial number; a ribbon without one is taken as uncalibrated."""

NO_CALIBRATIONS: Calibrations = {}


@dataclass(frozen=True)
class Ribbons:
    """What an estimator must know of the ribbons of an arrangement.

    rate_hz: of scans. `on_event` is told of ribbons that cannot be estimated, and why.
    """

    arrangement: Arrangement
    rate_hz: int
    calibrations: Calibrations
    on_event: Callable[[str, str], None]

    @property
    def layout(self) -> CombLayout | None:
        """Where the ribbons of a comb start on its reference; None if there is no comb."""
        return self.arrangement.layout

    def readings(self, index: int) -> "Readings":
        """Those of one ribbon, before its first scan."""
        return Readings(self.arrangement.places[index], self.rate_hz, self.calibrations, self.on_event)


def age_s(scan: Scan) -> float:
    """How old the accelerometers' readings are when their scan ends, on average."""
    return 1e-6 * scan.raw.accel_age_us if scan.raw else 0.0


def read_s(scan: Scan) -> float:
    """Host time of the accelerometers' readings of a scan, on average."""
    return scan.t_host_s - age_s(scan)


def without_readings(raw: wire.Raw) -> wire.Raw:
    """A RAW of the same ribbon whose readings are all said to be of no use."""
    stale = np.full(len(raw.accels), wire.SlotReason.STALE, np.uint8)
    return replace(raw, accels=replace(raw.accels, reason=stale), mags=replace(raw.mags, reason=stale))


class Readings:
    """Readings of one ribbon as samples for the estimator."""

    def __init__(
        self,
        place: Place,
        rate_hz: int,
        calibrations: Calibrations,
        on_event: Callable[[str, str], None],
    ) -> None:
        self._place = place
        self._rate_hz = rate_hz
        self._calibrations = calibrations
        self._on_event = on_event
        self._sampler: Sampler | None = None
        self._latest: Scan | None = None
        self._taken_us = 0

    def take(self, scan: Scan) -> tuple[Scan | None, bool]:
        """What of the next scan an estimator is to be given, and whether one has to begin anew with it.

        That is the scan; if its readings did not come, the scan with none of use, for PREDICTED_S after the
        latest that did; then None. It begins anew with the first readings, with those of another timing, and
        with those that are not later than all before, as after a reset of the clock.
        """
        latest = self._latest.raw if self._latest else None
        if scan.raw:
            begins_anew = (
                not latest or _timing(scan.raw) != _timing(latest) or _read_us(scan) <= self._taken_us
            )
            self._latest, self._taken_us = scan, _read_us(scan)
            return scan, begins_anew
        if not self._latest or not latest or scan.t_device_us - self._latest.t_device_us > 1e6 * PREDICTED_S:
            return None, False
        read = replace(scan, raw=without_readings(latest))
        if _read_us(read) <= self._taken_us:
            return None, False
        self._taken_us = _read_us(read)
        return read, False

    def params(self, scan: Scan) -> MotionParams | None:
        """Parameters from a scan on; None, and told, for a ribbon that cannot be estimated."""
        info = self._place.device.info if self._place.device else None
        assert info is not None  # scans come of devices that have said who they are
        assert scan.raw is not None
        calibration = self._calibrations.get(self._place.serial)
        try:
            self._sampler = Sampler(info, calibration)
            params = params_of(info, Timing.of(scan.raw), calibration, self._rate_hz)
            LiveMotion(params)
        except ValueError as error:
            self._on_event(self._place.label, f"is read as a level, its motion not estimated: {error}")
            return None
        return params

    @property
    def sampler(self) -> Sampler:
        """What makes samples of the readings. `params` must have been asked for before."""
        assert self._sampler
        return self._sampler


def samples_of(sampler: Sampler, scans: Sequence[Scan]) -> Samples:
    """Samples of scans with readings, on their devices' clocks."""
    pairs = [(s.raw, wire.NodeArray(s.q_world_node, s.valid, s.quality)) for s in scans if s.raw]
    return sampler.samples(pairs, 1e-6 * np.array([scan.t_device_us for scan in scans]))


def _read_us(scan: Scan) -> int:
    """Device time of the accelerometers' readings of a scan, on average."""
    return scan.t_device_us - (scan.raw.accel_age_us if scan.raw else 0)


def _timing(raw: wire.Raw) -> tuple[int, ...]:
    """What of a RAW's timing changes with the scan rate only."""
    return (raw.accel_period_us, raw.accel_span_us, raw.mag_period_us, raw.mag_span_us)
