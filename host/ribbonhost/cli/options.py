"""Arguments that several commands share."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from ribbonhost.cli import completion

URLS_HELP = (
    "Ports of ribbons: /dev/ttyACM0, COM5, /dev/rfcomm0 (Bluetooth), socket://HOST:PORT, "
    "or any other that pyserial opens; or their serial numbers, or names in the comb file."
)

CombOption = Annotated[
    Path | None, typer.Option(metavar="FILE", help="TOML file that says where each ribbon starts.")
]
BaudOption = Annotated[int, typer.Option(min=1200, help="Speed of serial ports, bits a second.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object a line.")]
ViewOption = Annotated[bool, typer.Option("--view", help="Serve a page that shows ribbons and surface.")]
ViewPortOption = Annotated[
    int | None,
    typer.Option(
        "--view-port", min=0, max=65535, help="Of the page.  [default: 8080, or the next that is free]"
    ),
]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace a file that is there already.")]
OutOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="TARGET",
        help="Send each frame to other programs: ndjson (stdout), ws://127.0.0.1:PORT, tcp://127.0.0.1:PORT, "
        "osc://HOST:PORT, or lsl. May be given several times.",
        autocompletion=completion.targets,
    ),
]


@dataclass(frozen=True)
class RibbonOptions:
    """How ribbons are found, and how it is told: what all commands that look after one share."""

    comb: CombOption = None
    baud: BaudOption = 921_600
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False


@dataclass(frozen=True)
class StreamOptions:
    """What `stream` and `record` are asked for; None where nothing was typed."""

    urls: Annotated[
        list[str] | None,
        typer.Argument(metavar="URL", help=URLS_HELP, autocompletion=completion.ribbons),
    ] = None
    comb: CombOption = None
    emulate: Annotated[
        str | None,
        typer.Option(
            metavar="SCENE",
            help="Emulate a comb on a surface: sea, wing, breath, or a file.py.",
            autocompletion=completion.scenes,
        ),
    ] = None
    ribbons: Annotated[
        int | None, typer.Option(min=2, max=6, help="Emulated ribbons on the reference.  [default: 5]")
    ] = None
    seed: Annotated[int | None, typer.Option(min=0, help="Of the emulated noise.  [default: 0]")] = None
    part_errors: Annotated[
        int | None,
        typer.Option(
            min=0, metavar="SEED", help="Emulate parts off the shelf, uncalibrated.  [default: ideal ones]"
        ),
    ] = None
    disturb: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND:...",
            help="Emulate what disturbs the field: magnet:at=X,Y,Z, beam:from=X,Y,Z:to=X,Y,Z, or "
            "carried:ribbon=1:slot=9. May be given several times.",
        ),
    ] = None
    rate_hz: Annotated[
        int | None,
        typer.Option(
            "--rate", min=1, max=200, help="Scans a second.  [default: 100, or less if a ribbon cannot]"
        ),
    ] = None
    seconds: Annotated[
        float | None, typer.Option(min=0.1, help="Stop after so long.  [default: at Ctrl-C]")
    ] = None
    method: Annotated[str, typer.Option(help="Of curves: spline, or hermite, the paper's.")] = "spline"
    motion: Annotated[
        str,
        typer.Option(
            metavar="off|live",
            help="live: estimate the ribbons' motion from their readings; off: take these for a level.",
        ),
    ] = "live"
    baud: BaudOption = 921_600
    reconnect: Annotated[
        bool, typer.Option(help="Look for ribbons whose ports vanish, and go on when they are back.")
    ] = True
    record: Annotated[Path | None, typer.Option(metavar="FILE.mcap", help="Record all that is received.")] = (
        None
    )
    force: ForceOption = False
    rotate_mib: Annotated[
        float | None, typer.Option(min=0.1, help="Record to FILE-001, -002 ..., each of so many MiB.")
    ] = None
    rotate_s: Annotated[
        float | None, typer.Option(min=1.0, help="Record to FILE-001, -002 ..., each so long.")
    ] = None
    out: OutOption = None
    view: ViewOption = False
    view_port: ViewPortOption = None
    json: JsonOption = False


def spread(
    kind: type, *, without: tuple[str, ...] = ()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Makes a command out of a function: its argument `options`, a dataclass of this kind, becomes an
    argument of the command line for each field, annotated as typer wants it, except those named."""

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        hints = get_type_hints(kind, include_extras=True)
        own = [
            p for p in inspect.signature(function, eval_str=True).parameters.values() if p.name != "options"
        ]
        spread_out = [f for f in fields(kind) if f.name not in without]

        def command(**typed: Any) -> None:
            options = kind(**{f.name: typed.pop(f.name) for f in spread_out})
            function(**typed, options=options)

        parameters = [p.replace(kind=p.KEYWORD_ONLY) for p in own] + [
            inspect.Parameter(
                f.name, inspect.Parameter.KEYWORD_ONLY, default=f.default, annotation=hints[f.name]
            )
            for f in spread_out
        ]
        command.__name__, command.__doc__ = function.__name__, function.__doc__
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        return command

    return decorate
