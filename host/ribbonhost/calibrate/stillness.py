"""Finds the poses in which a bar was held or put down, and averages the readings of each.

A hand never holds still: it trembles at some 10 Hz and wanders by a degree. All sensors of a bar share that,
so a pose is the mean of a window that falls smoothly to nothing at both ends (Hann), which the trembling does
not pass; what could be left of it along the bar is told to the solver with its standard deviation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d

from ribbonhost.calibrate.readings import Readings
from ribbonhost.calibrate.sensor_errors import STANDARD_GRAVITY_MPS2, Array, Poses

WINDOW_S = 1.5
"""So long a bar must be still to be a pose."""
WINDOW_MAX_S = 3.0
SMOOTH_S = 0.3
"""A moving mean of this length tells wandering from trembling."""
WANDER_RAD = np.radians(1.5)
"""Half of what a direction may range over in a window."""
ALMOST_RAD = np.radians(8.0)
"""What ranges over more was not meant to be still."""
SHAKE_MPS2 = 1.0
"""Root mean square of what trembles."""
TURNED_RAD = np.radians(12.0)
"""Two poses that are nearer are one."""
LYING_RAD = np.radians(0.1)
LYING_SHAKE_MPS2 = 0.012
"""On a table nothing wanders, and nothing trembles but the noise of the parts."""
FACE_RAD = np.radians(12.0)
"""A side that lies on a table is so near to level, however parts are mounted and tables stand."""
BATCHES = 6
FACES = np.array([[0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64)
HANN_EFFECTIVE = 1.5
"""Samples of a Hann window over the number of samples that a plain mean of the same variance takes."""


@dataclass(frozen=True)
class Stay:
    """A time in which the bar kept its attitude.

    first, last: scans of the readings, last not included. wander_rad: half of what gravity or the field
    ranged over. shake_mps2: root mean square of the trembling. still: whether it is a pose. lying: on a
    table, not in a hand.
    """

    first: int
    last: int
    wander_rad: float
    shake_mps2: float
    still: bool
    lying: bool


def find_stays(readings: Readings) -> list[Stay]:
    """All stays of at least WINDOW_S, in order.

    Stays that moved too much to be poses are among them, as not still.
    """
    scans = round(WINDOW_S * readings.rate_hz)
    if len(readings) < scans:
        return []
    accel = readings.accel_mps2.mean(axis=1)
    field = readings.field_ut.mean(axis=1)
    smooth = max(3, round(SMOOTH_S * readings.rate_hz))
    slow = uniform_filter1d(accel, smooth, axis=0, mode="nearest")
    slow_field = uniform_filter1d(field, smooth, axis=0, mode="nearest")
    field_size = float(np.median(np.linalg.norm(slow_field, axis=1))) or 1.0
    shake = np.sqrt(np.sum(uniform_filter1d((accel - slow) ** 2, scans, axis=0), axis=1))
    wander = np.maximum(
        _half_range(slow, scans) / STANDARD_GRAVITY_MPS2, _half_range(slow_field, scans) / field_size
    )
    gap = uniform_filter1d((np.diff(readings.t_s, prepend=readings.t_s[0]) > 0.5).astype(float), scans) > 0
    almost = (wander < ALMOST_RAD) & ~gap
    still = (wander < WANDER_RAD) & (shake < SHAKE_MPS2) & ~gap
    stays = [_stay(readings, first, last, wander, shake, slow, scans, True) for first, last in _runs(still)]
    for first, last in _runs(almost):
        if not still[first:last].any():
            stays.append(_stay(readings, first, last, wander, shake, slow, scans, False))
    stays.sort(key=lambda stay: stay.first)
    return _merged(stays, slow, slow_field)


def _half_range(signal: Array, scans: int) -> Array:
    span = maximum_filter1d(signal, scans, axis=0) - minimum_filter1d(signal, scans, axis=0)
    return np.asarray(np.linalg.norm(span, axis=1) / 2)


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def _stay(
    readings: Readings, first: int, last: int, wander: Array, shake: Array, slow: Array, scans: int,
    still: bool,
) -> Stay:  # fmt: skip
    """A run of window centres: the window around the stillest, grown as far as the run goes."""
    best = first + int(np.argmin(wander[first:last]))
    half = scans // 2
    grow = max(0, round((WINDOW_MAX_S - WINDOW_S) * readings.rate_hz / 2))
    low = max(0, best - half - min(grow, best - first))
    high = min(len(readings), best + half + min(grow, last - 1 - best) + 1)
    lies = wander[best] < LYING_RAD and shake[best] < LYING_SHAKE_MPS2 and _face(slow[best]) is not None
    return Stay(low, high, float(wander[best]), float(shake[best]), still, bool(lies))


def _face(accel: Array) -> Array | None:
    up = accel / np.linalg.norm(accel)
    along = FACES @ up
    best = int(np.argmax(along))
    return FACES[best] if along[best] > np.cos(FACE_RAD) else None


def _merged(stays: list[Stay], slow: Array, slow_field: Array) -> list[Stay]:
    """Neighbouring stays of one attitude are one pose: the stiller of them."""
    kept: list[Stay] = []
    for stay in stays:
        if (
            kept
            and _turn(slow, kept[-1], stay) < TURNED_RAD
            and _turn(slow_field, kept[-1], stay) < TURNED_RAD
        ):
            if (stay.still, -stay.wander_rad) > (kept[-1].still, -kept[-1].wander_rad):
                kept[-1] = stay
        else:
            kept.append(stay)
    return kept


def _turn(signal: Array, one: Stay, other: Stay) -> float:
    a, b = (signal[(stay.first + stay.last) // 2] for stay in (one, other))
    cosine = a @ b / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-9)
    return float(np.arccos(np.clip(cosine, -1, 1)))


def average(
    readings: Readings, stays: list[Stay], field_strength_ut: float, axes: int, pitch_m: float
) -> Poses:
    """The poses of stays. pitch_m: distance between neighbouring slots."""
    accel, field, noise, face, swing, growing = [], [], [], [], [], []
    places_m = (
        2 * pitch_m * (np.arange(readings.accel_mps2.shape[1]) - (readings.accel_mps2.shape[1] - 1) / 2)
    )
    for stay in stays:
        a = readings.accel_mps2[stay.first : stay.last]
        m = readings.field_ut[stay.first : stay.last, :, :axes]
        weight = np.hanning(len(a) + 2)[1:-1]
        weight /= weight.sum()
        accel.append(np.einsum("t,tni->ni", weight, a))
        field.append(np.einsum("t,tni->ni", weight, m))
        level = None if not stay.lying else _face(accel[-1].mean(axis=0))
        face.append(np.zeros(3) if level is None else level)
        spread = _spread(a, m, places_m, readings)
        noise.append(spread[:2])
        swing.append(0.0 if stay.lying else spread[2])
        growing.append(0.0 if stay.lying else spread[3])
    sigmas = np.array(noise).reshape(-1, 2)
    return Poses(
        np.array(accel).reshape(-1, *readings.accel_mps2.shape[1:]),
        np.array(field).reshape(-1, readings.field_ut.shape[1], axes),
        sigmas[:, 0],
        sigmas[:, 1],
        field_strength_ut,
        np.array(face).reshape(-1, 3),
        np.array(swing),
        np.array(growing),
        places_m,
    )


def _spread(
    accel: Array, field: Array, places_m: Array, readings: Readings
) -> tuple[float, float, float, float]:
    """Standard deviations of a pose's means: of one accelerometer, one magnetometer, of the acceleration
    common to all along gravity, and of that which grows along the bar; from the means of BATCHES parts.

    Turning with the hand is no error: all sensors turn alike, so what follows from the means over all is
    taken away from each.
    """
    scans, accels = accel.shape[:2]
    both = np.concatenate([accel.reshape(scans, -1), field.reshape(scans, -1)], axis=1)
    both -= both.mean(axis=0)
    common = np.concatenate([accel.mean(axis=1), field.mean(axis=1)], axis=1)
    common -= common.mean(axis=0)
    own = both - common @ np.linalg.lstsq(common, both, rcond=None)[0]
    length = scans // BATCHES * BATCHES
    own = own[:length].reshape(BATCHES, -1, own.shape[1]).mean(axis=1)
    own_accel = own[:, : accels * 3].reshape(BATCHES, accels, 3)
    lever = places_m / max(float(places_m @ places_m), 1e-9)
    slope = np.einsum("n,bni->bi", lever, own_accel)
    own_accel = own_accel - slope[:, None] * places_m[:, None]
    along = np.linalg.norm(accel[:length].reshape(BATCHES, -1, accels, 3).mean(axis=(1, 2)), axis=1)
    of_mean = np.sqrt(HANN_EFFECTIVE / (BATCHES - 1))
    rounding = np.sqrt(12 * scans / HANN_EFFECTIVE)
    return (
        float(np.hypot(of_mean * np.std(own_accel), readings.accel_lsb_mps2 / rounding)),
        float(np.hypot(of_mean * np.std(own[:, accels * 3 :]), readings.field_lsb_ut / rounding)),
        float(of_mean * np.std(along)),
        float(of_mean * np.sqrt(np.mean(slope**2))),
    )
