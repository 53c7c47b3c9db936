"""The earth's magnetic field at a place: from the World Magnetic Model, or as somebody knows it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date

from ribbonhost.errors import UsageError

MODEL = "wmm/WMM_2025.COF"


@dataclass(frozen=True)
class Place:
    """What the earth's field is where a ribbon is calibrated.

    Attributes:
        field_ut: its magnitude.
        dip_deg: how far it points down; None: not known.
        declination_deg: magnetic north east of true north; None: not known.
        source: where this is from.
        where: latitude and longitude in degrees, height above the ellipsoid in metres; None: not known.
    """

    field_ut: float
    dip_deg: float | None
    declination_deg: float | None
    source: str
    where: tuple[float, float, float] | None = None


def place_at(latitude_deg: float, longitude_deg: float, height_m: float, day: date) -> Place:
    """The field by the World Magnetic Model (NOAA/BGS), whose coefficients come with pygeomag.

    Raises UsageError for a place that is none, or a day that the model is not for.
    """
    if not (-90 <= latitude_deg <= 90 and -180 <= longitude_deg <= 360 and -1000 <= height_m <= 100_000):
        raise UsageError(
            f"{latitude_deg:g},{longitude_deg:g},{height_m:g} is no place: give --place "
            "LATITUDE,LONGITUDE[,METRES] in degrees north and east"
        )
    from pygeomag import GeoMag

    model = GeoMag(coefficients_file=MODEL)
    first, last = model.life_span
    year = day.year + (day.timetuple().tm_yday - 0.5) / (366 if _is_leap(day.year) else 365)
    if not first <= year <= last:
        raise UsageError(
            f"the magnetic model {model.model} is for {first:.0f} to {last:.0f} and not for {day}: install "
            "a later pygeomag, or give --field-ut, --dip-deg and --declination-deg by hand"
        )
    found = model.calculate(glat=latitude_deg, glon=longitude_deg, alt=height_m / 1000, time=year)
    return Place(
        field_ut=found.f / 1000,
        dip_deg=found.i,
        declination_deg=found.d,
        source=f"{model.model} on {day}",
        where=(latitude_deg, longitude_deg, height_m),
    )


def _is_leap(year: int) -> bool:
    return year % 4 == 0 and (year % 100 != 0 or year % 400 == 0)
