"""A calibration as a TOML file that a person can read and keep, and that gives the same record back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ribbonhost import wire
from ribbonhost.calibrate.bar import Result
from ribbonhost.calibrate.place import Place
from ribbonhost.cli.config_file import FORMAT as CONFIG_FORMAT
from ribbonhost.cli.config_file import calibration_lines, calibration_of, read_file, toml_text
from ribbonhost.cli.printing import name_of
from ribbonhost.errors import UsageError
from ribbonhost.record import Header

FORMAT = "ribbonhost calibration 1"


@dataclass(frozen=True)
class CalibrationFile:
    """What a file says: whose calibration it is, and the record."""

    serial: str
    calibration: wire.Calibration


def calibration_text(result: Result, info: wire.Info, *, source: str, version: str, now: datetime) -> str:
    """The file, with where the calibration comes from, how good it is, and how well each part is known."""
    lines = [
        "# What a ribbon's sensors are: `ribbonhost calibrate restore DEVICE FILE` gives it back.",
        f"format = {toml_text(FORMAT)}",
        "",
        "[device]",
        f"serial = {toml_text(bytes(info.unique_id).hex())}",
        f"board = {toml_text(name_of(wire.Board, info.board))}",
        f"firmware = {toml_text('.'.join(map(str, info.firmware_version)))}",
        "",
        "[provenance]",
        f"made = {now.astimezone(UTC).replace(tzinfo=None).isoformat(timespec='seconds')}Z",
        f"method = {toml_text(result.method)}",
        f"source = {toml_text(source)}",
        f"ribbonhost = {toml_text(version)}",
        f"calibration_sequence_before = {info.calibration_sequence}",
        *_temperatures(result),
        "",
        *place_lines(result.place),
        "",
        "[quality]",
        *quality_lines(result),
        "",
        *calibration_lines(result.record, info),
        *_sensor_lines(result, info),
    ]
    return "\n".join(lines) + "\n"


def place_lines(place: Place) -> list[str]:
    """The table [place]."""
    lines = ["[place]", f"source = {toml_text(place.source)}", f"field_ut = {place.field_ut:.3f}"]
    if place.dip_deg is not None:
        lines.append(f"dip_deg = {place.dip_deg:.3f}")
    if place.declination_deg is not None:
        lines.append(f"declination_deg = {place.declination_deg:.3f}  # magnetic north east of true north")
    if place.where:
        lines.append(f"latitude_deg = {place.where[0]:.5f}")
        lines.append(f"longitude_deg = {place.where[1]:.5f}")
        lines.append(f"height_m = {place.where[2]:.0f}")
    return lines


def quality_lines(result: Result) -> list[str]:
    """What is said of a calibration's quality, as TOML."""
    solution = result.solution
    lines = []
    if len(result.poses):
        lying = int(np.count_nonzero(np.linalg.norm(result.poses.up_face, axis=1) > 0.5))
        lines += [f"poses = {len(result.poses)}", f"poses_on_table = {lying}"]
    lines += [
        f"orientation_sigma_deg = {np.median(result.sigma_deg):.4f}  # of a node, half of them",
        f"orientation_sigma_worst_deg = {np.max(result.sigma_deg):.4f}",
        f"misfit = {np.sqrt(solution.chi2_per_dof):.3f}  # residuals over noise; 1 is as expected",
        f"dip_found_deg = {np.degrees(solution.parameters.dip_rad):.3f}",
        f"kept_back = {result.held_out}",
        f"disagreement_before_deg = {result.old_deg:.4f}  # of sensors in what was kept back",
        f"disagreement_deg = {result.new_deg:.4f}",
    ]
    return lines


def _temperatures(result: Result) -> list[str]:
    low, high = result.temperature_c
    return [] if np.isnan(low) else [f"temperature_c = [{low:.2f}, {high:.2f}]"]


def _sensor_lines(result: Result, info: wire.Info) -> list[str]:
    """One table a slot: parameters, their standard deviations, covariance, residual."""
    solution = result.solution
    names = np.array(solution.names)
    sigma = solution.sigma
    residual = np.zeros(len(info.slots.part))
    if solution.accel_residual.size:
        residual[0::2] = np.sqrt(np.mean(solution.accel_residual**2, axis=(0, 2)))
    if solution.field_residual.size:
        residual[1::2] = np.sqrt(np.mean(solution.field_residual**2, axis=(0, 2)))
    lines = []
    for slot in range(len(info.slots.part)):
        mine = np.flatnonzero(np.char.startswith(names, f"slot{slot}."))
        lines += [
            "",
            "[[sensor]]",
            f"slot = {slot}",
            f"part = {toml_text(name_of(wire.Part, int(info.slots.part[slot])))}",
            f"residual = {residual[slot]:.3f}  # over noise",
        ]
        for index in mine:
            name = str(names[index]).split(".", 1)[1]
            value, spread = solution.values[index], sigma[index]
            if name.startswith("mounting"):
                name, value, spread = f"{name}_deg", np.degrees(value), np.degrees(spread)
            lines.append(f"{name} = {{ value = {value:.6g}, sigma = {spread:.3g} }}")
        if len(mine):
            lines.append("covariance = [  # of these, in this order, radians for mountings; lower triangle")
            block = solution.covariance[np.ix_(mine, mine)]
            lines += [f"  {_short(block[row, : row + 1])}," for row in range(len(mine))]
            lines.append("]")
    return lines


def _short(values: NDArray[np.float64]) -> str:
    return f"[{', '.join(f'{value:.4g}' for value in values)}]"


def load_calibrations(paths: Sequence[Path], header: Header) -> dict[str, wire.Calibration]:
    """Later calibrations for a recording, by serial number. Raises UsageError, with the name of the file."""
    nodes = {ribbon.serial: ribbon.node_count for ribbon in header.ribbons}
    found: dict[str, wire.Calibration] = {}
    for path in paths:
        file = load_calibration(path)
        if file.serial not in nodes:
            raise UsageError(
                f"{path}: is of ribbon {file.serial}, which is not in the recording: {', '.join(nodes)} are"
            )
        if file.serial in found:
            raise UsageError(f"{path}: another file given is of ribbon {file.serial} too: give one")
        if len(file.calibration.slots.offset) != 2 * nodes[file.serial]:
            raise UsageError(
                f"{path}: has {len(file.calibration.slots.offset)} slots where the ribbon in the recording "
                f"has {2 * nodes[file.serial]}"
            )
        # In single precision, as the ribbon would use it.
        found[file.serial] = wire.Calibration.unpack(file.calibration.pack())
    return found


def load_calibration(path: Path) -> CalibrationFile:
    """Reads a file of `calibrate` or `config dump`. Raises UsageError, with its name, for anything else."""
    return read_file(
        path,
        (FORMAT, CONFIG_FORMAT),
        f'holds no calibration: format is not "{FORMAT}"',
        lambda tables: CalibrationFile(
            str(tables["device"]["serial"]), calibration_of(tables["calibration"])
        ),
    )
