"""The commands that calibrate ribbons. Nothing slow is imported before a command runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ribbonhost.cli.calibrate_options import BarOptions, CalibrateOptions, FlatOptions
from ribbonhost.cli.options import RibbonOptions, spread
from ribbonhost.cli.ribbons import NameArgument

HolderArgument = Annotated[
    str, typer.Argument(metavar="DEVICE_OR_FILE", help="A ribbon, or a calibration file (.toml).")
]


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    calibrate = typer.Typer(
        help="Find the errors of a ribbon's sensors, and let it know them.", no_args_is_help=True
    )
    calibrate.command(epilog="Example: ribbonhost calibrate bar 21d7 --place 45.19,5.72,212")(bar)
    calibrate.command(epilog="Example: ribbonhost calibrate flat 21d7 --seconds 60")(flat)
    calibrate.command("in-place", epilog="Example: ribbonhost calibrate in-place 21d7")(in_place)
    calibrate.command(epilog="Example: ribbonhost calibrate show 21d7")(show)
    calibrate.command(epilog="Example: ribbonhost calibrate diff 21d7 left.toml")(diff)
    calibrate.command(epilog="Example: ribbonhost calibrate restore 21d7 left.toml")(restore)
    app.add_typer(calibrate, name="calibrate")


@spread(BarOptions)
def bar(options: BarOptions) -> None:
    """Calibrate all sensors at once: the ribbon on a straight bar, turned as is said."""
    from ribbonhost.cli.calibrate_run import run_bar

    run_bar(options)


@spread(FlatOptions)
def flat(options: FlatOptions) -> None:
    """Refresh biases and mountings: the ribbon flat on a table, either side up."""
    from ribbonhost.cli.calibrate_run import run_flat

    run_flat(options)


@spread(CalibrateOptions)
def in_place(options: CalibrateOptions) -> None:
    """Find hard iron anew while the ribbon is used; nobody needs to handle it."""
    from ribbonhost.cli.calibrate_run import run_in_place

    run_in_place(options)


@spread(RibbonOptions)
def show(name: HolderArgument, options: RibbonOptions) -> None:
    """Print the calibration that a ribbon uses, or that a file holds, as errors of its sensors."""
    from ribbonhost.cli.calibrate_keep import run_show

    run_show(name, comb=options.comb, baud=options.baud, as_json=options.json)


@spread(RibbonOptions)
def diff(
    one: HolderArgument,
    other: HolderArgument,
    options: RibbonOptions,
) -> None:
    """Print how far two calibrations are apart."""
    from ribbonhost.cli.calibrate_keep import run_diff

    run_diff(one, other, comb=options.comb, baud=options.baud, as_json=options.json)


@spread(RibbonOptions)
def restore(
    name: NameArgument,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What `calibrate` wrote.")],
    force: Annotated[bool, typer.Option("--force", help="Even if it is of another ribbon.")] = False,
    *,
    options: RibbonOptions,
) -> None:
    """Give a ribbon the calibration of a file; it is replaced as a whole or not at all."""
    from ribbonhost.cli.calibrate_keep import run_restore

    run_restore(name, file, force=force, comb=options.comb, baud=options.baud, as_json=options.json)
