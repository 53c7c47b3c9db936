"""Poses that the motion estimator makes of readings, ribbon by ribbon, the reference of a comb first."""

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np

from ribbonhost import wire
from ribbonhost.device import Scan
from ribbonhost.motion import LiveMotion, Motion, MotionParams, Samples
from ribbonhost.motion.anchor import start_weights
from ribbonhost.motion.scans import Sampler, Timing, params_of
from ribbonhost.pipeline.arrangement import Arrangement, Place
from ribbonhost.pipeline.poses import (
    Float64,
    MotionCounts,
    MotionMode,
    Moving,
    Pose,
    SourceOf,
    device_poses,
    reading_of,
)

PREDICTED_S = 0.1
"""For so long after the last readings the estimate is carried on without; then the level reading serves."""

_AT_REST = np.zeros(3)

Calibrations = Mapping[str, wire.Calibration]
"""Calibration records by serial number; a ribbon without one is taken as uncalibrated."""

NO_CALIBRATIONS: Calibrations = {}


def source_of(
    motion: MotionMode,
    arrangement: Arrangement,
    *,
    rate_hz: int,
    calibrations: Calibrations,
    on_event: Callable[[str, str], None],
) -> SourceOf:
    """Where the poses of an arrangement's ribbons come from while their scans come.

    `on_event` is told of ribbons that cannot be estimated, and why.
    """
    if motion == "off":
        return device_poses
    return partial(LivePoses, arrangement, rate_hz=rate_hz, calibrations=calibrations, on_event=on_event)


class LivePoses:
    """Estimates each scan from the readings up to it. Not for several threads at once.

    What it makes depends on the scans and their order only.

    counts: of each ribbon.
    """

    def __init__(
        self,
        arrangement: Arrangement,
        places: Sequence[int],
        *,
        rate_hz: int,
        calibrations: Calibrations,
        on_event: Callable[[str, str], None],
    ) -> None:
        """places: which ribbons of the arrangement, the reference first if there is a comb.

        `on_event` is told of ribbons that cannot be estimated.
        """
        layout = arrangement.layout
        self._ribbons = [
            _Ribbon(place, rate_hz, calibrations.get(place.serial), on_event)
            for place in (arrangement.places[index] for index in places)
        ]
        self.counts = [ribbon.counts for ribbon in self._ribbons]
        self._starts = (
            start_weights(layout.node_count, layout.pitch_m, layout.start_m) if layout else np.zeros((0, 0))
        )
        self._reference: list[Pose] = []
        others = len(places) - 1
        # The C library works without the interpreter's lock: so many ribbons at once as there are cores.
        workers = min(others, os.cpu_count() or 1)
        self._pool = ThreadPoolExecutor(workers, "motion") if layout and workers > 1 else None

    def poses(self, scans: Sequence[tuple[int, Scan]]) -> list[Pose]:
        """See PoseSource."""
        of_ribbon: dict[int, list[Scan]] = {}
        for index, scan in scans:
            of_ribbon.setdefault(index, []).append(scan)
        made: dict[int, list[Pose]] = {}
        if len(self._starts) and 0 in of_ribbon:
            made[0] = [self._ribbons[0].pose(scan, _AT_REST) for scan in of_ribbon.pop(0)]
            self._reference = [*self._reference, *made[0]][-2:]
        work = list(of_ribbon.items())
        run = self._pool.map if self._pool and len(work) > 1 else map
        made.update(zip(of_ribbon, run(self._run, work), strict=True))
        order = {index: iter(poses) for index, poses in made.items()}
        return [next(order[index]) for index, _ in scans]

    def _run(self, work: tuple[int, list[Scan]]) -> list[Pose]:
        index, scans = work
        return [self._ribbons[index].pose(scan, self._known_mps2(index, scan)) for scan in scans]

    def _known_mps2(self, index: int, scan: Scan) -> Float64:
        """(3,) acceleration of the place where a ribbon starts: that of the reference there and then."""
        if not len(self._starts):
            return _AT_REST
        moving = [(p.t_host_s, p.moving) for p in self._reference if p.moving]
        if not moving:
            return _AT_REST
        weights = self._starts[index - 1]
        (t_s, newest), (before_s, before) = moving[-1], moving[0]
        at_mps2 = weights @ newest.acceleration_mps2
        at_s = read_s(scan)
        if before_s < at_s < t_s:
            share = (at_s - before_s) / (t_s - before_s)
            return np.asarray(share * at_mps2 + (1 - share) * (weights @ before.acceleration_mps2))
        return np.asarray(at_mps2)


def pose_of(motion: Motion, row: int, t_host_s: float) -> Pose | None:
    """The pose in a row of a motion; None if there is no estimate in it."""
    q_world_node = motion.q_world_node[row]
    if not np.isfinite(q_world_node).all():
        return None
    moving = Moving(
        motion.velocity_mps[row], motion.acceleration_mps2[row], motion.position_covariance_m2[row]
    )
    known = np.ones(len(q_world_node), np.bool_)
    return Pose(t_host_s, q_world_node, known, motion.sigma_rad[row], moving)


class _Ribbon:
    """The estimator of one ribbon."""

    def __init__(
        self,
        place: Place,
        rate_hz: int,
        calibration: wire.Calibration | None,
        on_event: Callable[[str, str], None],
    ) -> None:
        self.counts = MotionCounts()
        self._readings = Readings(place, rate_hz, calibration, on_event)
        self._motion: LiveMotion | None = None
        self._restarts = 0

    def pose(self, scan: Scan, known_mps2: Float64) -> Pose:
        """The pose of the next scan. known_mps2: (3,) acceleration of the ribbon's anchor."""
        read, begins_anew = self._readings.take(scan)
        if begins_anew:
            self._restarts = self.counts.restarts + bool(self._motion)
            params = self._readings.params(scan)
            self._motion = LiveMotion(params) if params else None
        if self._motion and read:
            pose = self._estimated(self._motion, read, known_mps2)
            if pose:
                self.counts.estimated += scan.raw is not None
                self.counts.predicted += scan.raw is None
                return pose
        self.counts.level += 1
        return reading_of(scan)

    def _estimated(self, motion: LiveMotion, scan: Scan, known_mps2: Float64) -> Pose | None:
        samples = replace(self._readings.samples([scan]), anchor_mps2=known_mps2[None])
        moved = motion.update(samples)
        self.counts.restarts = self._restarts + motion.counters["restarts"]
        return pose_of(moved, 0, read_s(scan)) if moved else None


def read_s(scan: Scan) -> float:
    """Host time of the accelerometers' readings of a scan, on average."""
    return scan.t_host_s - (1e-6 * scan.raw.accel_age_us if scan.raw else 0.0)


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
        calibration: wire.Calibration | None,
        on_event: Callable[[str, str], None] = lambda label, what: None,
    ) -> None:
        self._place = place
        self._rate_hz = rate_hz
        self._calibration = calibration
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
        try:
            self._sampler = Sampler(info, self._calibration)
            params = params_of(info, Timing.of(scan.raw), self._calibration, self._rate_hz)
            LiveMotion(params)
        except ValueError as error:
            self._on_event(self._place.label, f"is read as a level, its motion not estimated: {error}")
            return None
        return params

    def samples(self, scans: Sequence[Scan]) -> Samples:
        """Samples of scans with readings, on the device's clock. `params` must have been asked for before."""
        assert self._sampler
        pairs = [(s.raw, wire.NodeArray(s.q_world_node, s.valid, s.quality)) for s in scans if s.raw]
        return self._sampler.samples(pairs, 1e-6 * np.array([scan.t_device_us for scan in scans]))


def _read_us(scan: Scan) -> int:
    """Device time of the accelerometers' readings of a scan, on average."""
    return scan.t_device_us - (scan.raw.accel_age_us if scan.raw else 0)


def _timing(raw: wire.Raw) -> tuple[int, ...]:
    """What of a RAW's timing changes with the scan rate only."""
    return (raw.accel_period_us, raw.accel_span_us, raw.mag_period_us, raw.mag_span_us)
