"""The commands of `ribbonhost`. Nothing slow is imported before a command runs."""

from importlib.util import find_spec
from typing import Annotated

import typer

from ribbonhost.cli import calibrate, options, recording, ribbons


def build_app() -> typer.Typer:
    """The command line as typer wants it."""
    app = typer.Typer(
        name="ribbonhost",
        help="Turns the packets of sensor ribbons into curves and a C1 surface, live.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,  # a coloured help would take twice as long to appear
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_ribbonhost)
    app.command(epilog="Example: ribbonhost stream --emulate wing --seconds 10")(stream)
    ribbons.register(app)
    recording.register(app)
    calibrate.register(app)
    if find_spec("ribbonhost.bench") and find_spec("ribbonhost.bench.cli"):
        from ribbonhost.bench.cli import app as bench

        app.add_typer(bench, name="bench")
    return app


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(version("ribbonhost"))
        raise typer.Exit


def _ribbonhost(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    pass


@options.spread(options.StreamOptions)
def stream(options: options.StreamOptions) -> None:
    """Show ribbons live: rates, losses, latency, and the error where it is known."""
    from ribbonhost.cli.stream import run_stream

    run_stream(options)
