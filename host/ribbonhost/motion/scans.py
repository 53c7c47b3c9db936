"""From packets of a device to samples for the motion estimator: calibrated, and of known age."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ribbonhost import wire
from ribbonhost.motion.model import Float64, MotionParams, Samples

LIS2DW12_ODR_HZ = (12.5, 25.0, 50.0, 100.0, 200.0, 400.0, 800.0, 1600.0)
LIS2DW12_DIVISORS = (20, 10, 4, 2)
BANDWIDTH_MIN_HZ = 20.0
MMC5983MA_S = (0.008, 0.004, 0.002, 0.0005)
HALF_SCAN_S = 0.0005


@dataclass(frozen=True)
class Timing:
    """How old readings are at t_us, as the firmware sets the parts for a scan rate.

    A LIS2DW12 samples at least twice a scan by a clock of its own and averages down to 20 Hz; a MMC5983MA
    measures when it is told to, just before the scan.
    force_age_s, field_age_s: on average. force_jitter_s: standard deviation of the former.
    force_overlap: scans over which an accelerometer averages.
    """

    force_age_s: float
    field_age_s: float
    force_jitter_s: float
    force_overlap: float


def timing(rate_hz: float) -> Timing:
    """The ages at a scan rate. Raises ValueError for a rate that is not positive."""
    if not rate_hz > 0:
        raise ValueError(f"a scan rate of {rate_hz} Hz cannot be")
    odr_hz = next((odr for odr in LIS2DW12_ODR_HZ if odr >= 2 * rate_hz), LIS2DW12_ODR_HZ[-1])
    divisor = next(
        (d for d in LIS2DW12_DIVISORS if odr_hz >= d * BANDWIDTH_MIN_HZ),
        LIS2DW12_DIVISORS[-1],
    )
    measurement_s = next((m for m in MMC5983MA_S if 2 * m <= 1 / rate_hz), MMC5983MA_S[-1])
    averaged = divisor // 2
    return Timing(
        force_age_s=0.5 * (averaged + 1) / odr_hz + HALF_SCAN_S,
        # Told a tenth of its time earlier than the data sheet asks for; the field is that of the middle.
        field_age_s=0.6 * measurement_s + HALF_SCAN_S,
        force_jitter_s=1 / odr_hz / np.sqrt(12),
        force_overlap=max(1.0, averaged * rate_hz / odr_hz),
    )


def params_of(info: wire.Info, calibration: wire.Calibration | None = None) -> MotionParams:
    """Parameters for a device; without its calibration record: two field axes, the default field."""
    ages = timing(info.rate_hz)
    default = MotionParams()
    return MotionParams(
        node_count=info.node_count,
        pitch_m=float(info.pitch_m),
        field_ut=(0.0, float(calibration.field_horizontal_ut), -float(calibration.field_down_ut))
        if calibration
        else default.field_ut,
        field_axes=int(calibration.mag_axes) if calibration else default.field_axes,
        force_overlap=ages.force_overlap,
        force_jitter_s=float(ages.force_jitter_s),
        field_later_s=ages.force_age_s - ages.field_age_s,
    )


def samples_of(
    info: wire.Info,
    scans: Sequence[tuple[wire.Raw, wire.Orient]],
    t_s: Float64,
    calibration: wire.Calibration | None = None,
) -> Samples:
    """Samples of scans, each RAW with the ORIENT of the same sequence.

    t_s: (T,) times of the scans, on any clock that does not wrap; those of the samples are earlier by the
    age of the accelerometers' readings.
    """
    raws, orients = [raw for raw, _ in scans], [orient.nodes for _, orient in scans]
    slots = np.asarray(info.slots.lsb, dtype=np.float64)
    offset, matrix = np.zeros((len(slots), 3)), np.tile(np.eye(3), (len(slots), 1, 1))
    if calibration:
        offset = np.asarray(calibration.slots.offset, dtype=np.float64)
        matrix = np.asarray(calibration.slots.matrix, dtype=np.float64).reshape(-1, 3, 3)

    def calibrated(counts: Float64, first: int) -> Float64:
        value = counts * slots[first::2, None] - offset[first::2]
        return np.asarray(np.einsum("kij,tkj->tki", matrix[first::2], value))

    moving = wire.Quality.MOVING
    return Samples(
        t_s=np.asarray(t_s - timing(info.rate_hz).force_age_s, dtype=np.float64),
        force_mps2=calibrated(np.array([raw.accels.counts for raw in raws], dtype=np.float64), 0),
        field_ut=calibrated(np.array([raw.mags.counts for raw in raws], dtype=np.float64), 1),
        force_valid=np.array([raw.accels.reason for raw in raws]) == wire.SlotReason.OK,
        field_valid=np.array([raw.mags.reason for raw in raws]) == wire.SlotReason.OK,
        level_q=np.array([nodes.q_world_node for nodes in orients]),
        level_valid=np.array([nodes.valid for nodes in orients]),
        level_still=np.array([not (nodes.quality[nodes.valid] & moving).any() for nodes in orients]),
        anchor_mps2=np.zeros((len(raws), 3)),
    )
