"""Reads what an optical system, or the emulator, says of the places of nodes: CSV, NPZ, C3D."""

import csv
import re
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ribbonhost.errors import MissingExtraError, ValidationError

Array = NDArray[np.float64]

CSV_COLUMNS = ("t_s", "ribbon", "node", "x_m", "y_m", "z_m")
MARKER = re.compile(r"(?:.*[^a-z])?r(\d+)[_ .-]?n(\d+)", re.IGNORECASE)
"""Name of a marker in C3D: R, number of the ribbon, N, number of the node, both from 0."""

UNITS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
VALUES_MAX = 200_000_000


@dataclass(frozen=True)
class Truth:
    """Places of the nodes of R ribbons at U times of their own clock.

    t_s: (U,) increasing. node_m: (U, R, n, 3) metres, in any frame; NaN where nothing was seen.
    """

    t_s: Array
    node_m: Array

    def __post_init__(self) -> None:
        """Raises ValidationError unless the times increase and something was seen."""
        if len(self.t_s) < 4:
            raise ValidationError(f"{len(self.t_s)} instants are too few: at least 4 are needed")
        if not (np.isfinite(self.t_s).all() and (np.diff(self.t_s) > 0).all()):
            raise ValidationError("its times do not increase")
        if not np.isfinite(self.node_m).all(axis=-1).any():
            raise ValidationError("it holds no position")


def read_truth(path: Path, names: Sequence[str], nodes: int) -> Truth:
    """The truth for the ribbons of these names, which have so many nodes each.

    Raises ValidationError, with the file's name, if it cannot be read or is of other ribbons, and
    MissingExtraError where a library is needed.
    """
    readers = {".csv": _read_csv, ".npz": _read_npz, ".c3d": _read_c3d}
    if path.suffix.lower() not in readers:
        raise ValidationError(f"{path}: the ending must be one of {' '.join(readers)}")
    try:
        truth = readers[path.suffix.lower()](path, names, nodes)
    except OSError as error:
        raise ValidationError(f"{path} cannot be read: {error.strerror or error}") from error
    except ValidationError as error:
        raise ValidationError(f"{path}: {error}") from error
    return truth


def _empty(instants: int, names: Sequence[str], nodes: int) -> Array:
    if instants * len(names) * nodes * 3 > VALUES_MAX:
        raise ValidationError(f"{instants} instants are too many: cut it into pieces")
    return np.full((instants, len(names), nodes, 3), np.nan)


def _read_csv(path: Path, names: Sequence[str], nodes: int) -> Truth:
    """Rows of t_s, ribbon (its name, or its number from 0), node, x_m, y_m, z_m; more columns do no harm."""
    numbers = {str(index): index for index in range(len(names))} | {n: i for i, n in enumerate(names)}
    times: dict[float, int] = {}
    rows: list[tuple[int, int, int, float, float, float]] = []
    try:
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.reader(file)
            header = next(reader, [])
            if missing := [name for name in CSV_COLUMNS if name not in header]:
                raise ValidationError(f'its first line names no column "{missing[0]}"')
            columns = [header.index(name) for name in CSV_COLUMNS]
            for row in reader:
                if not row:
                    continue
                t, ribbon, node, *xyz = (row[column] for column in columns)
                if ribbon not in numbers:
                    raise ValidationError(
                        f'line {reader.line_num} is of ribbon "{ribbon}"; '
                        f"the recording has {', '.join(names)}"
                    )
                if not 0 <= int(node) < nodes:
                    raise ValidationError(
                        f"line {reader.line_num} is of node {node}; the recording has 0 to {nodes - 1}"
                    )
                x, y, z = (float(value) if value.strip() else np.nan for value in xyz)
                rows.append((times.setdefault(float(t), len(times)), numbers[ribbon], int(node), x, y, z))
    except (ValueError, IndexError, csv.Error) as error:
        raise ValidationError(f"line {reader.line_num} holds no numbers where they must be") from error
    t_s = np.array(list(times))
    node_m = _empty(len(t_s), names, nodes)
    if rows:
        table = np.array(rows)
        u, r, k = table[:, :3].astype(np.intp).T
        node_m[u, r, k] = table[:, 3:]
    return Truth(t_s, node_m)


def _read_npz(path: Path, names: Sequence[str], nodes: int) -> Truth:
    """t_s (U,) and node_position_m, as `ribbonhil truth` writes it, or node_m, as `export` does."""
    try:
        with np.load(path, allow_pickle=False) as data:
            key = next((key for key in ("node_position_m", "node_m") if key in data), None)
            if key is None or "t_s" not in data:
                raise ValidationError("it must hold t_s and node_position_m (or node_m)")
            t_s, node_m = np.asarray(data["t_s"], np.float64), np.asarray(data[key], np.float64)
    except (ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile) as error:
        raise ValidationError("it is no NPZ file of numbers") from error
    expected = (len(t_s) if t_s.ndim == 1 else -1, len(names), nodes, 3)
    if node_m.shape != expected:
        raise ValidationError(
            f"{key} has the shape {node_m.shape}; the recording has {len(names)} ribbons of {nodes} nodes"
        )
    return Truth(t_s, node_m)


def _read_c3d(path: Path, names: Sequence[str], nodes: int) -> Truth:
    """Markers named as MARKER says; others do not matter. Time 0 is the first frame."""
    try:
        import ezc3d
    except ImportError as error:
        raise MissingExtraError(".c3d", "ezc3d", "validate") from error
    path.open("rb").close()  # its absence in plain words
    try:
        file = ezc3d.c3d(str(path))
        point = file["parameters"]["POINT"]
        labels = [str(label) for label in point["LABELS"]["value"]]
        rate_hz = float(point["RATE"]["value"][0])
        unit = str((point.get("UNITS", {}).get("value") or ["mm"])[0]).strip().lower()
        points = np.asarray(file["data"]["points"], np.float64)[:3]
        residuals = np.asarray(file["data"]["meta_points"]["residuals"], np.float64)[0]
    except (RuntimeError, OSError, KeyError, IndexError, ValueError, TypeError) as error:
        raise ValidationError("it is no C3D file that can be read") from error
    if unit not in UNITS_M:
        raise ValidationError(f'its unit is "{unit}", not one of {", ".join(UNITS_M)}')
    if not rate_hz > 0:
        raise ValidationError(f"its rate is {rate_hz:g} Hz")
    node_m = _empty(points.shape[2], names, nodes)
    for place, label in enumerate(labels[: points.shape[1]]):
        if not (match := MARKER.fullmatch(label.strip())):
            continue
        ribbon, node = int(match[1]), int(match[2])
        if ribbon >= len(names) or node >= nodes:
            raise ValidationError(
                f"marker {label} is of no node: the recording has {len(names)} ribbons of {nodes} nodes"
            )
        seen = residuals[place] >= 0
        node_m[seen, ribbon, node] = points[:, place, seen].T * UNITS_M[unit]
    return Truth(np.arange(points.shape[2]) / rate_hz, node_m)
