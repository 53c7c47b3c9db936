"""What the commands that play, export and check recordings are asked for. Nothing slow is imported."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ribbonhost.cli.options import ForceOption, JsonOption, OutOption, ViewOption, ViewPortOption


@dataclass(frozen=True)
class ReconstructOptions:
    """How a recording is to be reconstructed; None where nothing was typed."""

    method: Annotated[
        str | None, typer.Option(help="Of curves: spline or hermite.  [default: that of the stream]")
    ] = None
    motion: Annotated[
        str | None,
        typer.Option(
            metavar="off|live|offline",
            help="Estimate motion from the readings up to each scan, or, offline, from all; off: take "
            "readings for a level.  [default: as in the stream]",
        ),
    ] = None
    calibration: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE.toml",
            help="Calibrate readings anew by what `calibrate` wrote; one file a ribbon.  "
            "[default: as recorded]",
        ),
    ] = None


@dataclass(frozen=True)
class PartOptions(ReconstructOptions):
    """Which part of a recording is to be reconstructed, for a file."""

    start_s: Annotated[float | None, typer.Option("--from", min=0.0, help="First second.")] = None
    end_s: Annotated[float | None, typer.Option("--to", min=0.0, help="Last second.")] = None
    force: ForceOption = False
    json: JsonOption = False


@dataclass(frozen=True)
class ReplayOptions(ReconstructOptions):
    """How a recording is to be played."""

    speed: Annotated[float, typer.Option(min=0.0, help="Times real time; 0: as fast as possible.")] = 1.0
    from_s: Annotated[float, typer.Option("--from", min=0.0, help="Begin at this second.")] = 0.0
    out: OutOption = None
    view: ViewOption = False
    view_port: ViewPortOption = None
    json: JsonOption = False


@dataclass(frozen=True)
class ExportOptions(PartOptions):
    """What is to be written of a recording."""

    rate_hz: Annotated[
        float | None, typer.Option("--rate", min=0.01, help="Frames a second.  [default: all there are]")
    ] = None
    up: Annotated[str, typer.Option(help="Axis that is up in the file: z or y.")] = "z"
    scale: Annotated[float, typer.Option(help="Units of the file a metre: 100 for centimetres.")] = 1.0


@dataclass(frozen=True)
class ValidateOptions(PartOptions):
    """How a recording is to be compared with the truth."""

    report: Annotated[
        Path | None, typer.Option(metavar="FILE.html", help="Write a page, and its plots as PNG.")
    ] = None
    offset_s: Annotated[
        float | None,
        typer.Option(
            "--offset", help="Time of the truth minus time of the recording, s.  [default: it is found]"
        ),
    ] = None
    max_offset_s: Annotated[
        float, typer.Option("--max-offset", min=0.001, help="The offset is searched up to so many seconds.")
    ] = 5.0
