"""`ribbonhost calibrate show`, `diff` and `restore`: what a ribbon or a file holds, and giving it back."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ribbonhost import wire
from ribbonhost.calibrate.record import parameters_of, strength_ut
from ribbonhost.calibrate.sensor_errors import STANDARD_GRAVITY_MPS2, Array, matrix_basis
from ribbonhost.cli.calibration_file import load_calibration
from ribbonhost.cli.naming import open_named
from ribbonhost.cli.printing import plain_table, print_table
from ribbonhost.device.calibration import read_calibration, write_calibration
from ribbonhost.errors import CalibrationError, UsageError


@dataclass(frozen=True)
class Held:
    """A calibration and who holds it."""

    holder: str
    serial: str
    calibration: wire.Calibration


def run_show(name: str, *, comb: Path | None, baud: int, as_json: bool) -> None:
    """Prints what a ribbon or a file holds. Raises RibbonError."""
    held = _held(name, comb, baud)
    if as_json:
        print(json.dumps({"calibration": {**_facts(held), "slots": _slot_facts(held.calibration)}}))
        return
    calibration = held.calibration
    print(f"{held.holder}: ribbon {held.serial}, {_made(calibration)}")
    dip_deg = np.degrees(np.arctan2(calibration.field_down_ut, calibration.field_horizontal_ut))
    print(
        f"{calibration.mag_axes} magnetometer axes, pitch {1e3 * calibration.pitch_m:.2f} mm, "
        f"field {strength_ut(calibration):.2f} uT, dip {dip_deg:.2f} deg"
    )
    table = plain_table("slot", "bias x y z", "scale %", "cross-axis %", "mounting deg")
    for slot, (bias, scale, cross, mounting) in enumerate(_errors(calibration)):
        unit = "uT" if slot % 2 else "mg"
        table.add_row(
            str(slot),
            f"{_numbers(bias if slot % 2 else bias * 1e3 / STANDARD_GRAVITY_MPS2)} {unit}",
            _numbers(100 * scale),
            _numbers(100 * cross),
            _numbers(np.degrees(mounting)),
        )
    print_table(table)


def run_diff(one: str, other: str, *, comb: Path | None, baud: int, as_json: bool) -> None:
    """Prints how far two calibrations are apart, slot by slot. Raises RibbonError."""
    first, second = _held(one, comb, baud), _held(other, comb, baud)
    if len(first.calibration.slots) != len(second.calibration.slots):
        raise UsageError(
            f"{one} has {len(first.calibration.slots)} slots and {other} "
            f"{len(second.calibration.slots)}: they are of different ribbons"
        )
    axes = min(int(first.calibration.mag_axes), int(second.calibration.mag_axes))
    rows = _apart(first.calibration, second.calibration, axes)
    if as_json:
        print(json.dumps({"diff": {"one": _facts(first), "other": _facts(second), "slots": rows}}))
        return
    for held in (first, second):
        print(f"{held.holder}: ribbon {held.serial}, {_made(held.calibration)}")
    if first.calibration.pack() == second.calibration.pack():
        print("They are equal.")
        return
    table = plain_table("slot", "bias", "gain %", "turned deg")
    for row in rows:
        unit = "uT" if row["slot"] % 2 else "mg"
        table.add_row(
            str(row["slot"]),
            f"{row['bias']:.3f} {unit}",
            f"{row['gain_percent']:.3f}",
            f"{row['turned_deg']:.3f}",
        )
    print_table(table)


def run_restore(name: str, path: Path, *, force: bool, comb: Path | None, baud: int, as_json: bool) -> None:
    """Gives a ribbon the calibration of a file. Raises UsageError, LinkError and DeviceError."""
    kept = load_calibration(path)
    device = open_named(name, baud=baud, comb=comb)
    try:
        if kept.serial != device.serial and not force:
            raise UsageError(
                f"{path} is of ribbon {kept.serial}, and {device.name} is {device.serial}: its sensors are "
                "others; --force gives it the file's calibration all the same"
            )
        assert device.info is not None  # a device that was opened has answered
        if len(kept.calibration.slots) != len(device.info.slots.part):
            raise UsageError(
                f"{path} has {len(kept.calibration.slots)} slots, and the ribbon on {device.name} has "
                f"{len(device.info.slots.part)}"
            )
        stored = write_calibration(device, kept.calibration)
    finally:
        device.close()
    if as_json:
        facts = {"serial": device.serial, "port": device.name, "file": str(path)}
        counted = {"calibration_sequence": stored.sequence, "calibration_crc32": f"{stored.crc32:08x}"}
        print(json.dumps({"restored": {**facts, **counted}}))
    else:
        print(
            f"Ribbon {device.serial} on {device.name} has back what {path} says: "
            f"calibration {stored.sequence}, CRC {stored.crc32:08x}, read back and equal."
        )


def _held(name: str, comb: Path | None, baud: int) -> Held:
    """A file if there is one of that name, else a ribbon."""
    path = Path(name)
    if path.suffix == ".toml" or path.is_file():
        kept = load_calibration(path)
        return Held(str(path), kept.serial, kept.calibration)
    device = open_named(name, baud=baud, comb=comb)
    try:
        return Held(device.name, device.serial, read_calibration(device).values)
    finally:
        device.close()


def _numbers(values: Array) -> str:
    return " ".join(f"{value:.2f}" for value in values)


def _made(calibration: wire.Calibration) -> str:
    if not calibration.created_s:
        return "never calibrated"
    made = datetime.fromtimestamp(calibration.created_s, UTC)
    return f"calibrated {made.isoformat(sep=' ', timespec='seconds')}"


def _facts(held: Held) -> dict[str, object]:
    calibration = held.calibration
    return {
        "holder": held.holder,
        "serial": held.serial,
        "created_s": calibration.created_s,
        "mag_axes": calibration.mag_axes,
        "pitch_m": calibration.pitch_m,
        "field_ut": strength_ut(calibration),
        "dip_deg": float(np.degrees(np.arctan2(calibration.field_down_ut, calibration.field_horizontal_ut))),
    }


def _matrices(calibration: wire.Calibration, axes: int) -> list[Array]:
    try:
        parameters = parameters_of(calibration, axes)
    except ValueError as error:
        raise CalibrationError(f"this calibration cannot be used: {error}") from error
    kinds = (parameters.accel_matrix, parameters.field_matrix)
    return [kinds[slot % 2][slot // 2] for slot in range(len(calibration.slots.offset))]


def _errors(calibration: wire.Calibration) -> list[tuple[Array, Array, Array, Array]]:
    """Bias, scale, cross-axis and mounting of each slot, by the linear basis of the calibration."""
    axes = int(calibration.mag_axes)
    rows = []
    offsets = np.asarray(calibration.slots.offset, dtype=np.float64)
    for slot, matrix in enumerate(_matrices(calibration, axes)):
        used = axes if slot % 2 else 3
        basis, names = matrix_basis(used)
        deviation = (matrix - np.eye(3)[:used]).ravel()
        values = np.linalg.lstsq(basis.reshape(len(names), -1).T, deviation, rcond=None)[0]
        kinds = np.array([name.split("_")[0] for name in names])
        parts = (values[kinds == "scale"], values[kinds == "cross"], values[kinds == "mounting"])
        rows.append((offsets[slot, :used], *parts))
    return rows


def _slot_facts(calibration: wire.Calibration) -> list[dict[str, object]]:
    return [
        {
            "slot": slot,
            "bias": bias.tolist(),
            "scale": scale.tolist(),
            "cross_axis": cross.tolist(),
            "mounting_deg": np.degrees(mounting).tolist(),
        }
        for slot, (bias, scale, cross, mounting) in enumerate(_errors(calibration))
    ]


def _apart(one: wire.Calibration, other: wire.Calibration, axes: int) -> list[dict[str, float]]:
    """How far the calibrations of each slot are apart: bias (mg or uT), gain, direction."""
    rows: list[dict[str, float]] = []
    pairs = zip(_matrices(one, axes), _matrices(other, axes), strict=True)
    offset = np.asarray(other.slots.offset - one.slots.offset, dtype=np.float64)
    for slot, (a, b) in enumerate(pairs):
        used = axes if slot % 2 else 3
        size_a, size_b = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
        cosine = np.sum(a * b, axis=1) / (size_a * size_b)
        bias = float(np.linalg.norm(offset[slot, :used]))
        rows.append(
            {
                "slot": slot,
                "bias": bias if slot % 2 else bias * 1e3 / STANDARD_GRAVITY_MPS2,
                "gain_percent": float(100 * np.abs(size_b / size_a - 1).max()),
                "turned_deg": float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).max()),
            }
        )
    return rows
