"""`ribbonhost bench`: how accurate and how fast the reconstruction is, measured without a device."""

import json as json_module
from pathlib import Path
from typing import Annotated

import typer

from ribbonhost.bench.motion import motion

app = typer.Typer(
    help="Measure accuracy and speed on this machine; no device is needed.", no_args_is_help=True
)

JSON_HELP = "Print one JSON object instead of tables."


@app.command(epilog="Example: ribbonhost bench accuracy --scene wing --json")
def accuracy(
    scene: Annotated[
        list[str] | None,
        typer.Option(
            metavar="SCENE", help="sea, wing, breath, or a file.py; may be repeated.  [default: all three]"
        ),
    ] = None,
    frames: Annotated[int, typer.Option(min=4, max=1000, help="Frames a scene, over one period.")] = 120,
    seed: Annotated[int, typer.Option(min=0, help="Of the emulated noise.")] = 0,
    json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
) -> None:
    """Error E of whole combs against the truth, percent of the ribbon's length, by data and method."""
    from ribbonhost.bench.accuracy import measure_accuracy
    from ribbonhost.bench.tables import accuracy_tables

    result = measure_accuracy(tuple(scene or ("sea", "wing", "breath")), frames, seed)
    typer.echo(json_module.dumps(result) if json else accuracy_tables(result))


@app.command(epilog="Example: ribbonhost bench speed --json")
def speed(json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False) -> None:
    """Times of frames, batches and threads, each beside what it is compared with."""
    from ribbonhost.bench.speed import measure_speed
    from ribbonhost.bench.tables import speed_tables

    result = measure_speed()
    typer.echo(json_module.dumps(result) if json else speed_tables(result))


@app.command(epilog="Example: ribbonhost bench report --folder docs")
def report(
    folder: Annotated[Path, typer.Option(file_okay=False, help="Where accuracy.md and its plots go.")] = Path(
        "docs"
    ),
) -> None:
    """Measure everything and write docs/accuracy.md with its plots (needs matplotlib)."""
    from ribbonhost.bench.report import write_report

    for path in write_report(folder):
        typer.echo(path)


@app.command(epilog="Example: ribbonhost bench calibration --seeds 5")
def calibration(
    seeds: Annotated[int, typer.Option(min=1, max=1000, help="Combs with errors of their own.")] = 20,
    scene: Annotated[str, typer.Option(metavar="SCENE", help="sea, wing, breath, or a file.py.")] = "wing",
    json: Annotated[bool, typer.Option("--json", help=JSON_HELP)] = False,
) -> None:
    """Error E of combs with the errors of real parts, before and after they are calibrated on a bar.

    Ends with exit code 1 if a calibration was refused.
    """
    from ribbonhost.bench.calibration import calibration_table, measure_calibration
    from ribbonhost.cli.progress import progress_bar

    with progress_bar("calibrate") as on_progress:
        result = measure_calibration(seeds, scene, on_progress)
    typer.echo(json_module.dumps(result) if json else calibration_table(result))
    if result["refused"]:
        raise typer.Exit(1)


app.command(epilog="Example: ribbonhost bench motion --scene wing --period 2")(motion)
