"""The commands that make, mend, play, export and check recordings; they load what is slow when they run."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from ribbonhost.cli import options
from ribbonhost.errors import UsageError

FILE_HELP = "Recording (.mcap)."

FilesArgument = Annotated[
    list[Path], typer.Argument(metavar="FILE", help="Recording (.mcap); all files of a rotated one.")
]
MethodOption = Annotated[
    str | None, typer.Option(help="Of curves: spline or hermite.  [default: that of the stream]")
]
MotionOption = Annotated[
    str | None,
    typer.Option(
        metavar="off|live|offline",
        help="Estimate motion from the readings up to each scan, or, offline, from all; off: take readings "
        "for a level.  [default: as in the stream]",
    ),
]
CalibrationOption = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="FILE.toml",
        help="Calibrate readings anew by what `calibrate` wrote; one file a ribbon.  [default: as recorded]",
    ),
]


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command(epilog="Example: ribbonhost record wing.mcap --emulate wing --seconds 10")(record)
    app.command(epilog="Example: ribbonhost recover wing.mcap")(recover)
    app.command(epilog="Example: ribbonhost finalise wing.mcap")(finalise)
    app.command(epilog="Example: ribbonhost replay wing.mcap --speed 0.5 --from 3")(replay)
    app.command(epilog="Example: ribbonhost export wing.mcap -o wing.usdc --from 1 --to 5 --rate 30")(export)
    app.command(epilog="Example: ribbonhost validate wing.mcap --truth truth.npz --report wing.html")(
        validate
    )


@options.spread(options.StreamOptions, without=("record",))
def record(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording to write (.mcap).")],
    options: options.StreamOptions,
) -> None:
    """Stream and record all that is received: `stream` with --record."""
    from ribbonhost.cli.stream import run_stream

    run_stream(replace(options, record=file))


def recover(
    file: Annotated[Path, typer.Argument(metavar="FILE", help=FILE_HELP)],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write here.  [default: in place of FILE]"),
    ] = None,
    force: options.ForceOption = False,
    json: options.JsonOption = False,
) -> None:
    """Make a recording whole that was cut off: by a kill, a crash, or a full disk."""
    from ribbonhost.cli.recover import run_recover

    if output is not None and output.exists() and not force:
        raise UsageError(f"{output} is there already: give another name, or --force to replace it")
    run_recover(file, output, json)


def finalise(
    file: Annotated[Path, typer.Argument(metavar="FILE", help=FILE_HELP)],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write here.  [default: in place of FILE]"),
    ] = None,
    rate: Annotated[float, typer.Option(min=0.1, help="Decoded frames a second, at most.")] = 30.0,
    force: options.ForceOption = False,
    json: options.JsonOption = False,
) -> None:
    """Add decoded channels, poses and surface, for Foxglove and other viewers; it plays as before."""
    from ribbonhost.cli.finalise import run_finalise

    if output is not None and output.exists() and not force:
        raise UsageError(f"{output} is there already: give another name, or --force to replace it")
    run_finalise(file, output, rate, json)


def replay(
    files: FilesArgument,
    speed: Annotated[float, typer.Option(min=0.0, help="Times real time; 0: as fast as possible.")] = 1.0,
    start: Annotated[float, typer.Option("--from", min=0.0, help="Begin at this second.")] = 0.0,
    method: MethodOption = None,
    motion: MotionOption = None,
    calibration: CalibrationOption = None,
    out: options.OutOption = None,
    view: options.ViewOption = False,
    view_port: options.ViewPortOption = None,
    json: options.JsonOption = False,
) -> None:
    """Play a recording through the same code as the stream; unchanged, it gives the same frames."""
    from ribbonhost.cli.replay import ReplayOptions, run_replay

    run_replay(
        files,
        ReplayOptions(
            speed=speed,
            from_s=start,
            method=method,
            motion=motion,
            calibration=tuple(calibration or ()),
            out=tuple(out or ()),
            view=view,
            view_port=view_port,
            json=json,
        ),
    )


def export(
    files: FilesArgument,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="File to write: .csv .npz .parquet .bvh .glb .usda .usdc .usdz .obj .ply .stl .html .mp4 "
            ".gif.",
        ),
    ],
    start: Annotated[float | None, typer.Option("--from", min=0.0, help="First second.")] = None,
    end: Annotated[float | None, typer.Option("--to", min=0.0, help="Last second.")] = None,
    rate: Annotated[
        float | None, typer.Option(min=0.01, help="Frames a second.  [default: all there are]")
    ] = None,
    up: Annotated[str, typer.Option(help="Axis that is up in the file: z or y.")] = "z",
    scale: Annotated[float, typer.Option(help="Units of the file a metre: 100 for centimetres.")] = 1.0,
    method: MethodOption = None,
    motion: MotionOption = None,
    calibration: CalibrationOption = None,
    force: options.ForceOption = False,
    json: options.JsonOption = False,
) -> None:
    """Write a recording as a file that other tools open; the ending says which."""
    from ribbonhost.cli.export import ExportOptions, run_export

    run_export(
        files,
        output,
        ExportOptions(start, end, rate, up, scale, method, motion, tuple(calibration or ()), force),
        json,
    )


def validate(
    files: FilesArgument,
    truth: Annotated[Path, typer.Option(metavar="FILE", help="Where nodes truly were: .csv, .npz, or .c3d.")],
    report: Annotated[
        Path | None, typer.Option(metavar="FILE.html", help="Write a page, and its plots as PNG.")
    ] = None,
    start: Annotated[float | None, typer.Option("--from", min=0.0, help="First second.")] = None,
    end: Annotated[float | None, typer.Option("--to", min=0.0, help="Last second.")] = None,
    offset: Annotated[
        float | None,
        typer.Option(help="Time of the truth minus time of the recording, s.  [default: it is found]"),
    ] = None,
    max_offset: Annotated[
        float, typer.Option(min=0.001, help="The offset is searched up to so many seconds.")
    ] = 5.0,
    method: MethodOption = None,
    motion: MotionOption = None,
    calibration: CalibrationOption = None,
    force: options.ForceOption = False,
    json: options.JsonOption = False,
) -> None:
    """Compare a recording with an optical system: time offset, alignment, E over time, error of each node."""
    from ribbonhost.cli.validate import ValidateOptions, run_validate

    run_validate(
        files,
        ValidateOptions(
            truth, report, start, end, offset, max_offset, method, motion, tuple(calibration or ()), force
        ),
        json,
    )
