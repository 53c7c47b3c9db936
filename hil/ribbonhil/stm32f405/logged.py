"""Plays readings that a real sensor recorded to an image, and compares its orientations with optical truth.

Every slot of the string sees the same sensor, as if the ribbon were a rigid bar.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from ribbonhost.errors import UsageError
from ribbonhost.wire import Orient, Quality, decode, sigma_rad

from ribbonhil.emulated_device import Device
from ribbonhil.stm32f405.boards import BOARDS
from ribbonhil.stm32f405.elf import read_image
from ribbonhil.stm32f405.image_ribbon import ImageRibbon
from ribbonhil.stm32f405.session import Session, SilentImageError
from ribbonhil.truth import SLOT_COUNT, RibbonTruth

Array = NDArray[np.float64]

SET_UP_S = 2.0  # how long the first reading is held, for start and calibration
STILL_SPREAD_MPS2 = 0.15  # of |a| over STILL_S, below which the sensor counts as still
STILL_S = 0.3
SLICE_S = 0.5
QUALITY_FLAGS = Quality.MOVING | Quality.FIELD_MAGNITUDE | Quality.FIELD_DIP | Quality.HEADING_AMBIGUOUS


class LogError(UsageError):
    """A file of readings that cannot be played."""


@dataclass(frozen=True, eq=False)
class Log:
    """T readings in equal steps from time 0.

    acc_mps2, mag_ut: (T, 3) in the sensor frame, which is taken as the node frame.
    q_world_sensor: (T, 4) optical truth, scalar first, NaN where there is none; its world may be turned about
        the vertical. None if the file has none.
    """

    step_s: float
    acc_mps2: Array
    mag_ut: Array
    q_world_sensor: Array | None


@dataclass(frozen=True)
class LocalField:
    """The earth's field where the readings were taken."""

    horizontal_ut: float
    down_ut: float


@dataclass(frozen=True)
class LogReport:
    """What came of a log.

    samples: orientations of nodes with truth beside them. good_share: of them, how many are valid and carry
        no flag. rmse_deg, p95_deg, within_3_sigma: of the good ones, after removing heading_offset_deg.
    The last five are None without truth, the last four also if no sample is good.
    """

    frames: int
    axes: int
    crc_errors: int
    overruns: int
    field_horizontal_ut: float
    field_down_ut: float
    samples: int
    good_share: float | None = None
    rmse_deg: float | None = None
    p95_deg: float | None = None
    within_3_sigma: float | None = None
    heading_offset_deg: float | None = None


def read_log(path: Path) -> Log:
    """Reads an NPZ file with t_s (T,), acc_mps2 (T, 3), mag_ut (T, 3), and q_world_sensor (T, 4) if there is.

    Raises LogError for anything else."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {
                name: np.asarray(file[name], dtype=np.float64) for name in file.files if name in _SHAPES
            }
    except OSError as error:
        if error.strerror:
            raise LogError(f"{path} cannot be read: {error.strerror}") from error
        raise LogError(f"{path} is no NPZ file") from error
    except (ValueError, TypeError, EOFError, KeyError, AttributeError, zipfile.BadZipFile) as error:
        raise LogError(f"{path} is no NPZ file of numbers ({error})") from error
    missing = [name for name in _SHAPES if name not in arrays and name != "q_world_sensor"]
    if missing:
        raise LogError(f"{path} has no {', '.join(missing)}")
    t_s = arrays["t_s"]
    if t_s.ndim != 1 or len(t_s) < 2 or not np.all(np.diff(t_s) > 0):
        raise LogError(f"{path}: t_s is not a row of two or more growing times")
    for name, array in arrays.items():
        if array.shape != (len(t_s), *_SHAPES[name]):
            raise LogError(f"{path}: {name} has the shape {array.shape}, not {(len(t_s), *_SHAPES[name])}")
        if name != "q_world_sensor" and not np.all(np.isfinite(array)):
            raise LogError(f"{path}: {name} has values that are no numbers")
    return _in_equal_steps(t_s - t_s[0], arrays)


_SHAPES: dict[str, tuple[int, ...]] = {"t_s": (), "acc_mps2": (3,), "mag_ut": (3,), "q_world_sensor": (4,)}


def _in_equal_steps(t_s: Array, arrays: dict[str, Array]) -> Log:
    step_s = float(t_s[-1] / (len(t_s) - 1))
    even_s = np.arange(len(t_s)) * step_s
    acc, mag = (
        np.column_stack([np.interp(even_s, t_s, column) for column in arrays[name].T])
        for name in ("acc_mps2", "mag_ut")
    )
    truth = arrays.get("q_world_sensor")
    if truth is not None:
        nearest = np.clip(np.searchsorted(t_s, even_s - step_s / 2), 0, len(t_s) - 1)
        truth = truth[nearest]
    return Log(step_s, acc, mag, truth)


def local_field(log: Log) -> LocalField:
    """Magnitude and dip, as a calibration at that place finds them: medians while the sensor is still.

    Raises LogError if it never is."""
    window = max(2, round(STILL_S / log.step_s))
    magnitude = np.linalg.norm(log.acc_mps2, axis=1)
    if len(magnitude) < window:
        raise LogError(f"the readings last less than {STILL_S:g} s")
    windows = np.lib.stride_tricks.sliding_window_view(magnitude, window)
    still = np.zeros(len(magnitude), dtype=bool)
    still[window // 2 : window // 2 + len(windows)] = windows.std(axis=1) < STILL_SPREAD_MPS2
    if not still.any():
        raise LogError("the sensor is never still: the local field cannot be told from its readings")
    level = log.acc_mps2[still] / magnitude[still, None]
    field_ut = np.median(np.linalg.norm(log.mag_ut[still], axis=1))
    down = -np.einsum("ij,ij->i", level, log.mag_ut[still])
    down_ut = float(np.median(down))
    return LocalField(float(np.sqrt(max(field_ut**2 - down_ut**2, 1.0))), down_ut)


def run_log(image: Path, log: Log, axes: int | None, board: str = "pyboard_v11") -> LogReport:
    """Plays a log to an image whose magnetometers have 2 or 3 axes; None: as many as it starts with.

    Raises RibbonError for an image that cannot be run or does not answer."""
    held = round(SET_UP_S / log.step_s)
    truth = RibbonTruth(
        specific_force_mps2=_at_every_slot(log.acc_mps2, held),
        field_ut=_at_every_slot(log.mag_ut, held),
        step_s=log.step_s,
        periodic=False,
    )
    ribbon = ImageRibbon(read_image(image), truth, Device(noise=0.0), BOARDS[board])
    session = Session(ribbon)
    session.wait_for_info()
    local = local_field(log)
    calibration = session.read_calibration()
    axes = axes or calibration.mag_axes
    session.write_calibration(
        replace(
            calibration,
            mag_axes=axes,
            created_s=1,
            field_horizontal_ut=local.horizontal_ut,
            field_down_ut=local.down_ut,
        )
    )
    start_s = held * log.step_s
    if ribbon.now_s > start_s:
        raise SilentImageError(f"The image took longer than {SET_UP_S:g} s to start and to be calibrated")
    overruns = session.current_status().overruns  # of storing the calibration
    ribbon.run_until(start_s)
    session.take(ribbon.read())
    first = len(session.orients)
    clock_starts_s = ribbon.now_s - ribbon.device_us * 1e-6
    end_s = start_s + (len(log.acc_mps2) - 1) * log.step_s
    while ribbon.now_s < end_s:
        session.run_for(min(SLICE_S, end_s - ribbon.now_s))
    status = session.current_status()
    decoded = [decode(packet)[0] for packet in session.orients[first:]]
    orients = [orient for orient in decoded if isinstance(orient, Orient)]
    report = LogReport(
        frames=len(orients),
        axes=axes,
        crc_errors=session.crc_errors,
        overruns=status.overruns - overruns,
        field_horizontal_ut=round(local.horizontal_ut, 3),
        field_down_ut=round(local.down_ut, 3),
        samples=0,
    )
    if log.q_world_sensor is None or not orients:
        return report
    t_s = np.array([orient.t_us for orient in orients]) * 1e-6 + clock_starts_s - start_s
    return _score(report, orients, t_s, log.q_world_sensor, log.step_s)


def _at_every_slot(values: Array, held: int) -> Array:
    """(T, 3) vectors as (held + T, SLOT_COUNT, 3), the first one held."""
    whole = np.concatenate([np.broadcast_to(values[0], (held, 3)), values])
    return np.repeat(whole[:, None], SLOT_COUNT, axis=1)


def _score(report: LogReport, orients: list[Orient], t_s: Array, truth: Array, step_s: float) -> LogReport:
    nearest = np.clip(np.rint(t_s / step_s).astype(int), 0, len(truth) - 1)
    q_truth = truth[nearest][:, None, :]
    q = np.stack([orient.nodes.q_world_node for orient in orients])
    valid = np.stack([orient.nodes.valid for orient in orients])
    quality = np.stack([orient.nodes.quality for orient in orients])
    has_truth = np.broadcast_to(np.isfinite(q_truth).all(axis=-1), valid.shape)
    sigma = sigma_rad(quality)
    good = has_truth & valid & ((quality & int(QUALITY_FLAGS)) == 0) & np.isfinite(sigma)
    samples = int(has_truth.sum())
    report = replace(report, samples=samples, good_share=round(good.sum() / max(samples, 1), 4))
    if not good.any():
        return report
    q_error = quaternion_product(q, conjugate(np.broadcast_to(q_truth, q.shape)))[good]
    heading = heading_offset_rad(q_error)
    turned_back = np.array([np.cos(heading / 2), 0.0, 0.0, -np.sin(heading / 2)])
    error_rad = angle_rad(quaternion_product(turned_back, q_error))
    return replace(
        report,
        rmse_deg=round(float(np.degrees(np.sqrt(np.mean(error_rad**2)))), 3),
        p95_deg=round(float(np.degrees(np.percentile(error_rad, 95))), 3),
        within_3_sigma=round(float(np.mean(error_rad <= 3.0 * sigma[good])), 4),
        heading_offset_deg=round(float(np.degrees(heading)), 2),
    )


def quaternion_product(a: Array, b: Array) -> Array:
    """Hamilton products, (..., 4), scalar first."""
    w, v = a[..., :1], a[..., 1:]
    x, u = b[..., :1], b[..., 1:]
    scalar = w * x - np.sum(v * u, axis=-1, keepdims=True)
    return np.concatenate([scalar, w * u + x * v + np.cross(v, u)], axis=-1)


def conjugate(q: Array) -> Array:
    """Quaternions (..., 4) of the opposite rotations."""
    turned: Array = q * np.array([1.0, -1.0, -1.0, -1.0])
    return turned


def angle_rad(q: Array) -> Array:
    """Angles of rotation, 0 to pi, of unit quaternions (..., 4)."""
    angle: Array = 2.0 * np.arctan2(np.linalg.norm(q[..., 1:], axis=-1), np.abs(q[..., 0]))
    return angle


def heading_offset_rad(q_error: Array) -> float:
    """The turn about the vertical that comes closest to all rotations q_error (N, 4), in the mean square.

    It maximises the sum of (w cos(psi/2) + z sin(psi/2))^2, whose phase is that of a sum of double angles."""
    w, z = q_error[:, 0], q_error[:, 3]
    return float(np.arctan2(np.sum(2.0 * w * z), np.sum(w * w - z * z)))
