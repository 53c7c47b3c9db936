"""From packets of a device to samples for the motion estimator: calibrated, and of known age."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from ribbonhost import wire
from ribbonhost.motion.model import Float64, MotionParams, Samples


@dataclass(frozen=True)
class Timing:
    """When the readings of a scan were taken, as its RAW says.

    force_age_s, field_age_s: how old they are at t_us, on average. force_jitter_s: standard deviation of the
    former. force_span_s: time that an accelerometer's reading is a mean over.
    """

    force_age_s: float
    field_age_s: float
    force_jitter_s: float
    force_span_s: float

    @classmethod
    def of(cls, raw: wire.Raw) -> "Timing":
        return cls(
            force_age_s=1e-6 * raw.accel_age_us,
            field_age_s=1e-6 * raw.mag_age_us,
            # Anywhere within a period of the part, with equal probability.
            force_jitter_s=1e-6 * raw.accel_period_us / 12**0.5,
            force_span_s=1e-6 * raw.accel_span_us,
        )


def params_of(
    info: wire.Info, timing: Timing, calibration: wire.Calibration | None = None, rate_hz: float | None = None
) -> MotionParams:
    """Parameters for a device; without its calibration record: two field axes, the default field.

    rate_hz: of scans, where it is no longer what INFO said.
    """
    default = MotionParams()
    return MotionParams(
        node_count=info.node_count,
        pitch_m=float(info.pitch_m),
        field_ut=(0.0, float(calibration.field_horizontal_ut), -float(calibration.field_down_ut))
        if calibration
        else default.field_ut,
        field_axes=int(calibration.mag_axes) if calibration else default.field_axes,
        field_normals=_field_normals(calibration) if calibration and calibration.mag_axes == 2 else None,
        force_overlap=max(1.0, timing.force_span_s * (rate_hz or info.rate_hz)),
        force_jitter_s=timing.force_jitter_s,
        field_later_s=timing.force_age_s - timing.field_age_s,
    )


def _field_normals(calibration: wire.Calibration) -> tuple[tuple[float, float, float], ...]:
    """(n, 3) where the axis that a two-axis magnetometer lacks would show in calibrated readings."""
    matrix = np.asarray(calibration.slots.matrix, dtype=np.float64).reshape(-1, 3, 3)
    return tuple((float(x), float(y), float(z)) for x, y, z in matrix[1::2, :, 2])


class Sampler:
    """Turns scans of a device into samples: counts into calibrated vectors of the node frame."""

    def __init__(self, info: wire.Info, calibration: wire.Calibration | None = None) -> None:
        """Without a calibration record: that of an uncalibrated device. Raises ValueError for one of another
        number of slots."""
        lsb = np.asarray(info.slots.lsb, dtype=np.float64)
        offset, matrix = np.zeros((len(lsb), 3)), np.tile(np.eye(3), (len(lsb), 1, 1))
        if calibration:
            offset = np.asarray(calibration.slots.offset, dtype=np.float64)
            matrix = np.asarray(calibration.slots.matrix, dtype=np.float64).reshape(-1, 3, 3)
        if len(offset) != len(lsb):
            raise ValueError(f"a calibration of {len(offset)} slots is not that of a ribbon of {len(lsb)}")
        self._matrix = matrix * lsb[:, None, None]
        self._zero = np.einsum("kij,kj->ki", matrix, offset)

    @classmethod
    def of_each(cls, samplers: "Sequence[Sampler]") -> Self:
        """A sampler of scans of which each is of another ribbon, in the order of theirs."""
        each = cls.__new__(cls)
        each._matrix = np.stack([sampler._matrix for sampler in samplers])
        each._zero = np.stack([sampler._zero for sampler in samplers])
        return each

    def samples(
        self, scans: Sequence[tuple[wire.Raw, wire.NodeArray | wire.NodeCompactArray]], t_s: Float64
    ) -> Samples:
        """Samples of scans, each RAW with the nodes of the ORIENT of the same sequence.

        t_s: (T,) times of the scans, on any clock that does not wrap; those of the samples are earlier by the
        age of the accelerometers' readings.
        """
        raws, nodes = [raw for raw, _ in scans], [nodes for _, nodes in scans]
        moving = wire.Quality.MOVING
        return Samples(
            t_s=np.asarray(t_s - np.array([1e-6 * raw.accel_age_us for raw in raws]), dtype=np.float64),
            force_mps2=self._calibrated(np.array([raw.accels.counts for raw in raws], np.float64), 0),
            field_ut=self._calibrated(np.array([raw.mags.counts for raw in raws], np.float64), 1),
            force_valid=np.array([raw.accels.reason for raw in raws]) == wire.SlotReason.OK,
            field_valid=np.array([raw.mags.reason for raw in raws]) == wire.SlotReason.OK,
            level_q=np.array([node.q_world_node for node in nodes]),
            level_valid=np.array([node.valid for node in nodes]),
            level_still=np.array([not (node.quality[node.valid] & moving).any() for node in nodes]),
            anchor_mps2=np.zeros((len(raws), 3)),
        )

    def _calibrated(self, counts: Float64, first: int) -> Float64:
        """(T, n, 3) of the slots first, first + 2 ..."""
        turned = np.matmul(self._matrix[..., first::2, :, :], counts[..., None])[..., 0]
        return np.asarray(turned - self._zero[..., first::2, :])


def samples_of(
    info: wire.Info,
    scans: Sequence[tuple[wire.Raw, wire.Orient]],
    t_s: Float64,
    calibration: wire.Calibration | None = None,
) -> Samples:
    """Sampler.samples of whole ORIENT packets."""
    return Sampler(info, calibration).samples([(raw, orient.nodes) for raw, orient in scans], t_s)
