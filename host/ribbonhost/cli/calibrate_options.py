"""What `ribbonhost calibrate` is asked for. Nothing slow is imported."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ribbonhost.cli import completion
from ribbonhost.cli.options import ForceOption, RibbonOptions


@dataclass(frozen=True)
class CalibrateOptions(RibbonOptions):
    """What all ways to calibrate share; None where nothing was typed."""

    name: Annotated[
        str | None,
        typer.Argument(
            metavar="DEVICE",
            help="A ribbon as for `info`; may be left out with --from.",
            autocompletion=completion.ribbons,
        ),
    ] = None
    from_recording: Annotated[
        Path | None,
        typer.Option("--from", metavar="RECORDING.mcap", help="Use the RAW packets of a recording."),
    ] = None
    serial: Annotated[
        str, typer.Option(metavar="SERIAL", help="Which ribbon of the recording, if there are several.")
    ] = ""
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="File to write.  [default: calibration-SERIAL-TIME.toml]"
        ),
    ] = None
    force: ForceOption = False
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Write the file, but not to the ribbon.")] = False
    place: Annotated[
        str | None,
        typer.Option(metavar="LAT,LON[,M]", help="Where it is: degrees north and east, metres of height."),
    ] = None
    day: Annotated[
        str | None,
        typer.Option("--date", metavar="YYYY-MM-DD", help="For the magnetic model.  [default: today]"),
    ] = None
    field_ut: Annotated[
        float | None, typer.Option(min=1.0, max=100.0, help="Strength of the field, instead of --place.")
    ] = None
    dip_deg: Annotated[
        float | None, typer.Option(min=-90.0, max=90.0, help="How far the field points down.")
    ] = None
    rate_hz: Annotated[int, typer.Option("--rate", min=20, max=200, help="Scans a second meanwhile.")] = 50
    seconds: Annotated[float, typer.Option(min=10.0, help="How long.")] = 120.0
    record: Annotated[
        Path | None, typer.Option(metavar="FILE.mcap", help="Keep all that is received, for --from.")
    ] = None


@dataclass(frozen=True)
class BarOptions(CalibrateOptions):
    """Of the straight bar."""

    seconds: Annotated[float, typer.Option(min=10.0, help="End after so long.")] = 900.0
    declination_deg: Annotated[
        float | None, typer.Option(min=-180.0, max=180.0, help="Magnetic north east of true north.")
    ] = None
    axes: Annotated[int, typer.Option(min=2, max=3, help="Magnetometer axes that are used.")] = 2
    pitch_mm: Annotated[
        float | None,
        typer.Option(min=1.0, max=1000.0, help="Between slots, by a ruler.  [default: as the ribbon says]"),
    ] = None
    poses: Annotated[int, typer.Option(min=16, max=200, help="End after so many, whatever is missing.")] = 36


@dataclass(frozen=True)
class FlatOptions(CalibrateOptions):
    """Of the refresh on a table."""

    seconds: Annotated[float, typer.Option(min=6.0, help="How long.")] = 60.0
