"""What a ribbon is set to, as a TOML file that a person can read and that gives the same bytes back."""

import json
import math
import tomllib
from collections.abc import Callable, Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ribbonhost import wire
from ribbonhost.cli.printing import name_of
from ribbonhost.errors import UsageError
from ribbonhost.framing import crc32

FORMAT = "ribbonhost config 1"

T = TypeVar("T")


@dataclass(frozen=True)
class DeviceConfig:
    """The settings of one ribbon.

    Attributes:
        serial: of the ribbon that it was read from.
        rate_hz: scans a second.
        mode: what it sends.
        calibration: what it knows of its sensors.
    """

    serial: str
    rate_hz: int
    mode: wire.Mode
    calibration: wire.Calibration


def config_text(config: DeviceConfig, info: wire.Info, *, port: str, version: str, now: datetime) -> str:
    """The file, with what else is worth knowing of where it comes from."""
    calibration = config.calibration
    lines = [
        "# What a ribbon is set to: `ribbonhost config restore DEVICE FILE` gives it back.",
        f"format = {toml_text(FORMAT)}",
        "",
        "[device]",
        f"serial = {toml_text(config.serial)}",
        f"board = {toml_text(name_of(wire.Board, info.board))}",
        f"firmware = {toml_text('.'.join(map(str, info.firmware_version)))}",
        f"wire_version = {info.wire_version}",
        f"schema = {toml_text(f'{info.schema_hash:08x}')}",
        "",
        "[provenance]",
        f"dumped = {now.astimezone(UTC).replace(tzinfo=None).isoformat(timespec='seconds')}Z",
        f"port = {toml_text(port)}",
        f"ribbonhost = {toml_text(version)}",
        f"calibration_sequence = {info.calibration_sequence}",
        "",
        "[settings]",
        f"rate_hz = {config.rate_hz}",
        f"mode = [{', '.join(toml_text(name) for name in mode_names(config.mode))}]",
        "",
    ]
    return "\n".join([*lines, *calibration_lines(calibration, info)]) + "\n"


def calibration_lines(calibration: wire.Calibration, info: wire.Info) -> list[str]:
    """The tables [calibration] and [[calibration.slot]], each number as it is on the device."""
    created = datetime.fromtimestamp(calibration.created_s, UTC).isoformat(timespec="seconds")
    made = f"made {created}" if calibration.created_s else "never calibrated"
    lines = [
        f"[calibration]  # {made}",
        f'crc32 = "{crc32(calibration.pack()):08x}"  # of the record; without this line it may be edited',
        f"layout = {calibration.layout}",
        f"mag_axes = {calibration.mag_axes}",
        f"created_s = {calibration.created_s}",
        f"pitch_m = {single(calibration.pitch_m)}",
        f"field_horizontal_ut = {single(calibration.field_horizontal_ut)}",
        f"field_down_ut = {single(calibration.field_down_ut)}",
    ]
    slots = calibration.slots
    for slot, (offset, matrix) in enumerate(zip(slots.offset, slots.matrix, strict=True)):
        part = name_of(wire.Part, int(info.slots.part[slot]))
        rows = ", ".join(singles(row) for row in matrix.reshape(3, 3))
        lines += [
            "",
            f"[[calibration.slot]]  # {slot}: {part}",
            f"offset = {singles(offset)}",
            f"matrix = [{rows}]",
        ]
    return lines


def load_config(path: Path) -> DeviceConfig:
    """Reads a file of `config dump`. Raises UsageError, with the file's name, for anything else."""
    return read_file(
        path, (FORMAT,), f'is no file of `ribbonhost config dump`: format is not "{FORMAT}"', _config_of
    )


def read_file(path: Path, formats: Collection[str], what_else: str, make: Callable[[dict[str, Any]], T]) -> T:
    """What `make` makes of the tables of a file of one of these formats.

    what_else: what to say of a file of another. Raises UsageError, with the file's name.
    """
    try:
        tables = tomllib.loads(path.read_bytes().decode())
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UsageError(f"{path}: is not TOML: {error}") from error
    if tables.get("format") not in formats:
        raise UsageError(f"{path}: {what_else}")
    try:
        return make(tables)
    except KeyError as error:
        raise UsageError(f"{path}: {error.args[0]} is missing") from error
    except (TypeError, ValueError, AttributeError, OverflowError, wire.WireError) as error:
        raise UsageError(f"{path}: holds what cannot be: {error}") from error


def mode_names(mode: wire.Mode) -> list[str]:
    """The names of what a mode sends."""
    return [str(flag.name).lower() for flag in wire.Mode if flag in mode]


def calibration_of(table: dict[str, object]) -> wire.Calibration:
    """The record of a table [calibration]. Raises KeyError, TypeError, ValueError, AttributeError or
    OverflowError for what is none.
    """
    slots = table.get("slot", [])
    if not isinstance(slots, list):
        raise TypeError("calibration.slot is no list of tables")
    calibration = wire.Calibration(
        layout=_whole(table, "layout"),
        mag_axes=_whole(table, "mag_axes"),
        created_s=_whole(table, "created_s"),
        pitch_m=_number(table["pitch_m"]),
        field_horizontal_ut=_number(table["field_horizontal_ut"]),
        field_down_ut=_number(table["field_down_ut"]),
        slots=wire.SlotCalibrationArray(
            offset=np.array([_numbers(slot["offset"], (3,)) for slot in slots]).reshape(-1, 3),
            matrix=np.array([_numbers(slot["matrix"], (3, 3)) for slot in slots]).reshape(-1, 9),
        ),
    )
    found = f"{crc32(calibration.pack()):08x}"
    if (stated := table.get("crc32", found)) != found:
        raise ValueError(
            f"the calibration was changed since it was written (its CRC is {found}, not {stated}); "
            "without the line crc32 it is taken as it is"
        )
    return calibration


def _config_of(tables: dict[str, dict[str, object]]) -> DeviceConfig:
    settings, calibration = tables["settings"], calibration_of(tables["calibration"])
    mode = wire.Mode(0)
    names = settings["mode"]
    if not isinstance(names, list):
        raise TypeError("settings.mode is no list of names")
    for name in names:
        if str(name).upper() not in wire.Mode.__members__:
            raise ValueError(
                f'mode "{name}" is not one of {", ".join(f.lower() for f in wire.Mode.__members__)}'
            )
        mode |= wire.Mode[str(name).upper()]
    return DeviceConfig(str(tables["device"]["serial"]), _whole(settings, "rate_hz"), mode, calibration)


def _whole(table: dict[str, object], key: str) -> int:
    value = table[key]
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError(f"{key} = {value!r} is no whole number")
    return value


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise TypeError(f"{value!r} is no number")
    return float(value)


def _numbers(values: object, shape: tuple[int, ...]) -> list[object]:
    if not isinstance(values, list) or len(values) != shape[0]:
        raise TypeError(f"{values!r} is no list of {shape[0]}")
    return [_numbers(value, shape[1:]) if shape[1:] else _number(value) for value in values]


def single(value: float) -> str:
    """The shortest text that reads as the same single-precision number."""
    return str(np.float32(value))


def singles(values: NDArray[np.float64]) -> str:
    return f"[{', '.join(single(value) for value in values)}]"


def toml_text(value: str) -> str:
    """A TOML basic string: JSON's escapes are among TOML's."""
    return json.dumps(value, ensure_ascii=False)
