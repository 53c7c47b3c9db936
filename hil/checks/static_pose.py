"""What a ribbon says of its pose while it lies still: orientations that stay, and an honest sigma."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from ribbonhil.check.bench import Bench
from ribbonhil.check.check import Measurement, NotRunError, Topic, none_of
from ribbonhil.check.readings import REST_MPS2, Readings
from ribbonhil.truth import GRAVITY_MPS2
from ribbonhost.wire import Quality

TOPIC = Topic("static_pose")

GRAVITY_CALIBRATED_PERCENT = 1.0
"""As STATUS.health has it; gravity itself differs by 0.3 % over the earth."""
GRAVITY_UNCALIBRATED_PERCENT = 10.0
"""Four standard deviations of the bias (20 mg) and scale (1.5 %) of a LIS2DW12."""
FIELD_CALIBRATED_PERCENT = 5.0
"""Between sensors of one ribbon: indoors the field itself differs by a few per cent over its length."""
FIELD_UT = (10.0, 150.0)
"""The earth's is 22 to 67 uT; solder and iron beside an uncalibrated sensor add tens."""
WANDER_UT = 0.5
"""Between quarters of a recording; a hundredth of the earth's field."""
COVERED_PERCENT = 97.0
"""Share of orientations that must be within three of their own sigmas; of normal scatter it is 99.7 %."""
SIGMAS = 3.0

Array = NDArray[np.float64]


@TOPIC.check
def gravity_and_field(bench: Bench) -> Iterator[Measurement]:
    """Each accelerometer reads g, and each magnetometer a field as there is on earth, and both go on reading
    the same. Held to the calibration if there is one, else to what parts off the shelf may be wrong by."""
    readings = bench.at_rest()
    calibration = bench.calibration.slots
    matrix = calibration.matrix.reshape(-1, 3, 3)

    def calibrated(slots: slice) -> Array:
        return np.asarray(
            np.einsum("sij,sj->si", matrix[slots], readings.mean(slots) - calibration.offset[slots])
        )

    accelerometers, magnetometers = slice(0, None, 2), slice(1, None, 2)
    excess = 100 * (np.linalg.norm(calibrated(accelerometers), axis=1) / GRAVITY_MPS2 - 1)
    limit = GRAVITY_CALIBRATED_PERCENT if bench.is_calibrated else GRAVITY_UNCALIBRATED_PERCENT
    told = "calibrated" if bench.is_calibrated else "never calibrated"
    yield largest("|a| differs from g by", excess, "%", accelerometers, limit, told)

    field_ut = np.linalg.norm(calibrated(magnetometers), axis=1)
    known_ut = field_ut[np.isfinite(field_ut)]
    has_three_axes = bench.calibration.mag_axes == 3 and len(known_ut) > 0
    yield Measurement("|B|, smallest", float(known_ut.min(initial=np.inf)), "uT", low=FIELD_UT[0])
    highest_ut = float(known_ut.max(initial=-np.inf))
    yield Measurement("|B|, largest", highest_ut, "uT", low=FIELD_UT[0], high=FIELD_UT[1])
    if bench.is_calibrated and has_three_axes:
        off = 100 * (field_ut / np.median(known_ut) - 1)
        yield largest(
            "|B| differs from its median by", off, "%", magnetometers, FIELD_CALIBRATED_PERCENT, told
        )
    wander = readings.wander(accelerometers)
    yield largest("accelerometers wander by", wander, "m/s^2", accelerometers, REST_MPS2)
    yield largest("magnetometers wander by", readings.wander(magnetometers), "uT", magnetometers, WANDER_UT)


@TOPIC.check
def orientations(bench: Bench) -> Iterator[Measurement]:
    """Every node has an orientation with a stated sigma, and while the ribbon lies still it stays within
    three of them: a sigma that is too small is a promise that the device does not keep."""
    readings = bench.at_rest()
    invalid = np.flatnonzero(~readings.valid.all(axis=0))
    yield none_of("nodes not valid all the time", (f"node {node}" for node in invalid))
    unknown = np.flatnonzero((readings.valid & ~np.isfinite(readings.sigma_rad)).any(axis=0))
    yield none_of("nodes without sigma", (f"node {node}" for node in unknown))
    scatter_rad = angle_rad(readings.q_world_node, mean_orientation(readings))
    covered = [share_within(*node) for node in zip(scatter_rad.T, readings.sigma_rad.T, strict=True)]
    least = int(np.argmin(np.nan_to_num(covered, nan=-1.0)))
    yield Measurement(
        "within 3 sigma, least", 100 * covered[least], "%", low=COVERED_PERCENT, where=f"node {least}"
    )
    rms_deg = np.degrees([rms(node) for node in scatter_rad.T])
    most = int(np.argmax(np.nan_to_num(rms_deg, nan=-1.0)))
    yield Measurement("scatter, RMS, most", float(rms_deg[most]), "deg", where=f"node {most}")
    yield Measurement("sigma stated, RMS", float(np.degrees(rms(readings.sigma_rad))), "deg")
    for flag in Quality:
        share = 100 * float(np.mean(readings.flags & (flag >> 4) != 0))
        if share:
            yield Measurement(f"orientations flagged {(flag.name or '').lower()}", share, "%")


@TOPIC.check
def straight_edge(bench: Bench) -> Iterator[Measurement]:
    """A ribbon along a straight edge is straight: neighbouring nodes point the same way within three of their
    sigmas. The only check of the pose itself, and of the calibration; it needs --straight."""
    if not bench.options.straight:
        raise NotRunError("it needs a ribbon that lies along a straight edge: --straight")
    readings = bench.at_rest()
    q = mean_orientation(readings)
    turn_rad = angle_rad(q[1:], q[:-1])
    sigma_rad = np.array([rms(node) for node in readings.sigma_rad.T])
    ratio = turn_rad / np.hypot(sigma_rad[1:], sigma_rad[:-1])
    known = np.flatnonzero(np.isfinite(ratio))
    if not len(known):
        raise NotRunError("no two neighbouring nodes are valid")
    worst = known[np.argmax(ratio[known])]
    between = f"nodes {worst} and {worst + 1}"
    yield Measurement("turn between neighbours, largest", float(np.degrees(turn_rad[known].max())), "deg")
    yield Measurement("turn between neighbours", float(ratio[worst]), "sigma", high=SIGMAS, where=between)


def largest(what: str, values: Array, unit: str, slots: slice, limit: float, remark: str = "") -> Measurement:
    """The value of largest size, which may be at most a limit, of every second slot; NaN if there is none."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return Measurement(what, float("nan"), unit, high=limit, where="no readings")
    worst = known[np.argmax(np.abs(values[known]))]
    where = f"slot {slots.start + 2 * worst}{f', {remark}' if remark else ''}"
    low = -limit if np.min(values[known]) < 0 else None
    return Measurement(what, float(values[worst]), unit, low=low, high=limit, where=where)


def mean_orientation(readings: Readings) -> Array:
    """(N, 4) the mean of each node's orientations, unit quaternions; NaN for one that is never valid."""
    q = np.where(readings.valid[..., None], readings.q_world_node, 0.0)
    # The mean of a cluster: the eigenvector of the largest eigenvalue of the sum of q q^T.
    _, vectors = np.linalg.eigh(np.einsum("tni,tnj->nij", q, q))
    return np.where(np.any(readings.valid, axis=0)[:, None], vectors[:, :, -1], np.nan)


def angle_rad(a: Array, b: Array) -> Array:
    """The angle of the turn between orientations (..., 4), exact for small ones."""
    dot = np.sum(a * b, axis=-1)
    nearer = np.where(dot[..., None] < 0, -b, b)
    apart, together = np.linalg.norm(a - nearer, axis=-1), np.linalg.norm(a + nearer, axis=-1)
    return np.asarray(4 * np.arctan2(apart, together))


def rms(values: Array) -> float:
    """Root mean square of those that are known; NaN if none is."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def share_within(scatter_rad: Array, sigma_rad: Array) -> float:
    """The share of known orientations that is within three sigmas of the mean; NaN if none is known."""
    known = np.isfinite(scatter_rad) & np.isfinite(sigma_rad)
    return float(np.mean(scatter_rad[known] <= SIGMAS * sigma_rad[known])) if known.any() else float("nan")
