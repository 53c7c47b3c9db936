"""The commands that look for ribbons and look after one. Nothing slow is imported before a command runs."""

from pathlib import Path
from typing import Annotated

import typer

from ribbonhost.cli import completion
from ribbonhost.cli.options import ForceOption, RibbonOptions, spread

NAME_HELP = "A ribbon: its port, its serial number or how that starts, or its name in the comb file."

NameArgument = Annotated[
    str, typer.Argument(metavar="DEVICE", help=NAME_HELP, autocompletion=completion.ribbons)
]
PortsArgument = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="DEVICE",
        help="Ports to ask besides the serial ports of this machine; or ribbons, of which alone it is told.",
        autocompletion=completion.ribbons,
    ),
]


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command(epilog="Example: ribbonhost info /dev/ttyACM0")(info)
    app.command(epilog="Example: ribbonhost devices")(devices)
    app.command(epilog="Example: ribbonhost identify 21d7 --seconds 10")(identify)
    app.command("rate-test", epilog="Example: ribbonhost rate-test 21d7 --rates 50,100,200")(rate_test)
    app.command(epilog="Example: ribbonhost doctor")(doctor)
    config = typer.Typer(
        help="Keep what a ribbon is set to in a file, and give it back.", no_args_is_help=True
    )
    config.command("dump", epilog="Example: ribbonhost config dump 21d7 -o left.toml")(config_dump)
    config.command("restore", epilog="Example: ribbonhost config restore 21d7 left.toml")(config_restore)
    app.add_typer(config, name="config")


@spread(RibbonOptions)
def info(name: NameArgument, options: RibbonOptions) -> None:
    """Ask a ribbon who it is and how it is."""
    from ribbonhost.cli.info import run_info

    run_info(name, options.baud, options.comb, options.json)


@spread(RibbonOptions)
def devices(
    names: PortsArgument = None,
    *,
    options: RibbonOptions,
) -> None:
    """List the ribbons on the ports of this machine; each port is asked once who is there."""
    from ribbonhost.cli.devices import run_devices

    run_devices(names or (), options.comb, options.baud, options.json)


@spread(RibbonOptions)
def identify(
    name: NameArgument,
    seconds: Annotated[float, typer.Option(help="For how long, at most 60; 0 ends it.")] = 10.0,
    *,
    options: RibbonOptions,
) -> None:
    """Let a ribbon's LED blink, to see which one it is."""
    from ribbonhost.cli.identify import run_identify

    run_identify(name, seconds, comb=options.comb, baud=options.baud, as_json=options.json)


@spread(RibbonOptions)
def config_dump(
    name: NameArgument,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Write to a file instead of stdout.")
    ] = None,
    force: ForceOption = False,
    *,
    options: RibbonOptions,
) -> None:
    """Write calibration, rate and mode of a ribbon as TOML."""
    from ribbonhost.cli.config import run_dump

    run_dump(name, output, force=force, comb=options.comb, baud=options.baud, as_json=options.json)


@spread(RibbonOptions)
def config_restore(
    name: NameArgument,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What `config dump` wrote.")],
    force: Annotated[bool, typer.Option("--force", help="Even if it is of another ribbon.")] = False,
    *,
    options: RibbonOptions,
) -> None:
    """Give a ribbon back what a file says; its calibration is replaced as a whole or not at all."""
    from ribbonhost.cli.config import run_restore

    run_restore(name, file, force=force, comb=options.comb, baud=options.baud, as_json=options.json)


@spread(RibbonOptions)
def rate_test(
    name: NameArgument,
    rates: Annotated[
        str | None, typer.Option(metavar="HZ,HZ", help="Scans a second to try.  [default: 50,100,150,200]")
    ] = None,
    seconds: Annotated[float, typer.Option(help="For each rate in each mode.")] = 1.0,
    *,
    options: RibbonOptions,
) -> None:
    """Measure which rates a ribbon and its link carry in each mode; it is left as it was found."""
    from ribbonhost.cli.rate_test import run_rate_test

    run_rate_test(name, rates, seconds, comb=options.comb, baud=options.baud, as_json=options.json)


@spread(RibbonOptions)
def doctor(
    names: PortsArgument = None,
    *,
    options: RibbonOptions,
) -> None:
    """Check this machine, its ports and each ribbon, and say what to do; exit code 1 if a check fails."""
    from ribbonhost.cli.doctor import run_doctor

    run_doctor(names or (), options.comb, options.baud, options.json)
