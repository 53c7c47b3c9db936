"""The comb file: which device is the reference ribbon and where the others start on it."""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ribbonhost.errors import CombFileError

SAME_PLACE_M = 1e-3
"""Ribbons that start closer together than this are taken to be on one place by mistake."""

SERIAL_DIGITS = 24
"""Hexadecimal digits of a serial number: the 12 bytes of the device's unique id."""


@dataclass(frozen=True)
class CombRibbon:
    """One ribbon that starts on the reference.

    Attributes:
        serial: serial number of its device, lower-case hexadecimal.
        start_m: arc length on the reference, from the reference's anchor, where it starts.
        name: what to call it; empty: its serial number.
    """

    serial: str
    start_m: float
    name: str = ""


@dataclass(frozen=True)
class Comb:
    """A comb as its file describes it.

    Attributes:
        reference: serial number of the reference ribbon's device.
        pitch_m: distance between neighbouring slots, of all ribbons.
        ribbons: the two or more ribbons on the reference, start_m increasing.
        name: what to call the comb; may be empty.
        slots: sensors that each ribbon must have; None: any number, the same for all.
        parts: names of the parts that each ribbon must consist of, in no order; None: any.
    """

    reference: str
    pitch_m: float
    ribbons: tuple[CombRibbon, ...]
    name: str = ""
    slots: int | None = None
    parts: frozenset[str] | None = None

    def __post_init__(self) -> None:
        """Raises CombFileError unless the values make a comb."""
        if len(self.ribbons) < 2:
            raise CombFileError(
                f"a surface spans between ribbons, and {len(self.ribbons)} of at least 2 [[ribbon]] are here"
            )
        if not (math.isfinite(self.pitch_m) and 0.001 <= self.pitch_m <= 1.0):
            raise CombFileError(f"pitch_m = {self.pitch_m:g} is not between 0.001 and 1 m")
        if self.slots is not None and self.slots < 4:
            raise CombFileError(f"slots = {self.slots}: a ribbon has at least 4 sensors")
        object.__setattr__(self, "ribbons", tuple(sorted(self.ribbons, key=lambda ribbon: ribbon.start_m)))
        serials = [self.reference] + [ribbon.serial for ribbon in self.ribbons]
        for serial in serials:
            if len(serial) != SERIAL_DIGITS or not set(serial) <= set("0123456789abcdef"):
                raise CombFileError(
                    f'serial "{serial}" is not {SERIAL_DIGITS} hexadecimal digits as `ribbonhost info` prints'
                )
        for serial in self.serials:
            if serials.count(serial) > 1:
                raise CombFileError(f"ribbon {serial} is in the file twice")
        for ribbon in self.ribbons:
            if not (math.isfinite(ribbon.start_m) and ribbon.start_m >= 0):
                raise CombFileError(f"ribbon {ribbon.serial} starts at {ribbon.start_m:g} m: not 0 or more")
            if self.slots is not None:
                self.check_start(ribbon, self.slots)
        for first, second in zip(self.ribbons, self.ribbons[1:], strict=False):
            if second.start_m - first.start_m < SAME_PLACE_M:
                raise CombFileError(
                    f"ribbons {first.serial} and {second.serial} both start at {second.start_m:g} m"
                )

    @property
    def serials(self) -> tuple[str, ...]:
        """Serial numbers, the reference first, then by start."""
        return (self.reference, *(ribbon.serial for ribbon in self.ribbons))

    def label(self, serial: str) -> str:
        """What to call the ribbon with this serial number, which must be one of the comb."""
        if serial == self.reference:
            return "reference"
        return next(r.name or f"at {r.start_m:g} m" for r in self.ribbons if r.serial == serial)

    def check_start(self, ribbon: CombRibbon, slots: int) -> None:
        """Raises CombFileError if the ribbon starts beyond a reference of so many slots.

        The curve of a ribbon is known from its anchor to its last sensor.
        """
        length_m = (slots - 1) * self.pitch_m
        if ribbon.start_m > length_m + 1e-9:
            raise CombFileError(
                f"ribbon {ribbon.serial} starts at {ribbon.start_m:g} m, "
                f"beyond the end of the reference at {length_m:g} m"
            )

    def to_toml(self) -> str:
        """The text of a comb file that reads as this comb."""
        lines = ["[comb]"]
        if self.name:
            lines.append(f"name = {_quoted(self.name)}")
        lines += [f'reference = "{self.reference}"', f"pitch_m = {self.pitch_m!r}"]
        if self.slots is not None:
            lines.append(f"slots = {self.slots}")
        if self.parts is not None:
            lines.append(f"parts = [{', '.join(_quoted(part) for part in sorted(self.parts))}]")
        for ribbon in self.ribbons:
            lines += ["", "[[ribbon]]", f'serial = "{ribbon.serial}"', f"start_m = {ribbon.start_m!r}"]
            if ribbon.name:
                lines.append(f"name = {_quoted(ribbon.name)}")
        return "\n".join(lines) + "\n"


def load_comb(path: Path | str) -> Comb:
    """Reads a comb file.

    Raises CombFileError, with the file's name in its message, if the file cannot be read or describes no
    comb.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise CombFileError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        return parse_comb(data.decode())
    except UnicodeDecodeError as error:
        raise CombFileError(f"{path}: is not text in UTF-8 (byte {error.start})") from error
    except CombFileError as error:
        raise CombFileError(f"{path}: {error}") from error


def parse_comb(text: str) -> Comb:
    """The comb that the text of a comb file describes. Raises CombFileError if it describes none."""
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CombFileError(f"is not TOML: {error}") from error
    _check_keys("the file", tables, required={"comb"}, optional={"ribbon"})
    head = tables["comb"]
    if not isinstance(head, dict):
        raise CombFileError("comb must be a table: [comb]")
    _check_keys("[comb]", head, required={"reference", "pitch_m"}, optional={"name", "slots", "parts"})
    entries = tables.get("ribbon", [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise CombFileError("ribbon must be a list of tables: [[ribbon]]")
    ribbons = []
    for number, entry in enumerate(entries, start=1):
        where = f"[[ribbon]] number {number}"
        _check_keys(where, entry, required={"serial", "start_m"}, optional={"name"})
        ribbons.append(
            CombRibbon(
                _text(where, entry, "serial").lower(),
                _number(where, entry, "start_m"),
                _text(where, entry, "name", ""),
            )
        )
    slots = head.get("slots")
    if slots is not None and (not isinstance(slots, int) or isinstance(slots, bool)):
        raise CombFileError(f"slots of [comb] must be a whole number, not {slots!r}")
    parts = head.get("parts")
    if parts is not None and (
        not isinstance(parts, list) or not parts or not all(isinstance(part, str) for part in parts)
    ):
        raise CombFileError('parts of [comb] must be a list of names such as ["lis2dw12", "mmc5983ma"]')
    return Comb(
        _text("[comb]", head, "reference").lower(),
        _number("[comb]", head, "pitch_m"),
        tuple(ribbons),
        name=_text("[comb]", head, "name", ""),
        slots=slots,
        parts=None if parts is None else frozenset(part.lower() for part in parts),
    )


def _check_keys(where: str, table: Mapping[str, object], *, required: set[str], optional: set[str]) -> None:
    if missing := sorted(required - table.keys()):
        raise CombFileError(f"{missing[0]} is missing in {where}")
    if unknown := sorted(table.keys() - required - optional):
        known = ", ".join(sorted(required | optional))
        raise CombFileError(f'unknown key "{unknown[0]}" in {where}: it may hold {known}')


def _text(where: str, table: Mapping[str, object], key: str, default: str | None = None) -> str:
    value = table.get(key, default)
    if not isinstance(value, str):
        raise CombFileError(f"{key} of {where} must be text in quotes, not {value!r}")
    return value


def _number(where: str, table: Mapping[str, object], key: str) -> float:
    value = table[key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CombFileError(f"{key} of {where} must be a number in metres, not {value!r}")
    try:
        return float(value)
    except OverflowError:
        raise CombFileError(f"{key} of {where} is no length") from None


def _quoted(text: str) -> str:
    """A TOML basic string."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c >= " " and c != "\x7f" else f"\\u{ord(c):04x}" for c in escaped) + '"'
