"""Where on earth, and with which pitch, `ribbonhost calibrate` is to work."""

from __future__ import annotations

import math
from datetime import UTC, date, datetime

from ribbonhost import wire
from ribbonhost.calibrate.place import Place, place_at
from ribbonhost.calibrate.record import strength_ut
from ribbonhost.cli.calibrate_options import BarOptions, CalibrateOptions
from ribbonhost.errors import UsageError


def pitch_m_of(options: BarOptions, info: wire.Info | None) -> float:
    """Distance between neighbouring slots, as given or as the ribbon says."""
    if options.pitch_mm is not None:
        return options.pitch_mm / 1000
    assert info is not None  # there are readings
    return float(info.pitch_m)


def place_of(options: CalibrateOptions, in_use: wire.Calibration | None, *, lenient: bool = False) -> Place:
    """The field of the place as it was given; else that of the calibration in use.

    Raises UsageError if there is none.
    """
    if options.place is not None:
        try:
            numbers = [float(word) for word in options.place.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3):
            raise UsageError(
                f"--place {options.place} is not LATITUDE,LONGITUDE or LATITUDE,LONGITUDE,METRES"
            )
        return place_at(numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else 0.0, _day(options.day))
    if options.field_ut is not None:
        declination_deg = options.declination_deg if isinstance(options, BarOptions) else None
        return Place(options.field_ut, options.dip_deg, declination_deg, "given by hand")
    if in_use is not None and in_use.created_s:
        dip_deg = math.degrees(math.atan2(in_use.field_down_ut, in_use.field_horizontal_ut))
        return Place(strength_ut(in_use), dip_deg, None, "the calibration in use")
    if lenient:
        return Place(math.nan, None, None, "")
    raise UsageError(
        "the strength of the earth's field is needed, which no pose tells: give --place "
        "LATITUDE,LONGITUDE, or --field-ut with --dip-deg"
    )


def _day(text: str | None) -> date:
    if text is None:
        return datetime.now(UTC).date()
    try:
        return date.fromisoformat(text)
    except ValueError as error:
        raise UsageError(f"--date {text} is no date: write it as 2026-11-24") from error
