"""The commands that make, mend, play, export and check recordings; they load what is slow when they run."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from ribbonhost.cli import options
from ribbonhost.cli.recording_options import ExportOptions, ReplayOptions, ValidateOptions
from ribbonhost.errors import UsageError

FILE_HELP = "Recording (.mcap)."

FilesArgument = Annotated[
    list[Path], typer.Argument(metavar="FILE", help="Recording (.mcap); all files of a rotated one.")
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


@options.spread(ReplayOptions)
def replay(files: FilesArgument, options: ReplayOptions) -> None:
    """Play a recording through the same code as the stream; unchanged, it gives the same frames."""
    from ribbonhost.cli.replay import run_replay

    run_replay(files, options)


@options.spread(ExportOptions)
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
    options: ExportOptions,
) -> None:
    """Write a recording as a file that other tools open; the ending says which."""
    from ribbonhost.cli.export import run_export

    run_export(files, output, options)


@options.spread(ValidateOptions)
def validate(
    files: FilesArgument,
    truth: Annotated[Path, typer.Option(metavar="FILE", help="Where nodes truly were: .csv, .npz, or .c3d.")],
    options: ValidateOptions,
) -> None:
    """Compare a recording with an optical system: time offset, alignment, E over time, error of each node."""
    from ribbonhost.cli.validate import run_validate

    run_validate(files, truth, options)
