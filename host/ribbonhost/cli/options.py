"""Arguments that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

URLS_HELP = (
    "Ports of ribbons: /dev/ttyACM0, COM5, /dev/rfcomm0 (Bluetooth), socket://HOST:PORT, "
    "or any other that pyserial opens; or their serial numbers, or names in the comb file."
)

UrlsArgument = Annotated[list[str] | None, typer.Argument(metavar="URL", help=URLS_HELP)]
CombOption = Annotated[
    Path | None, typer.Option(metavar="FILE", help="TOML file that says where each ribbon starts.")
]
EmulateOption = Annotated[
    str | None,
    typer.Option(metavar="SCENE", help="Emulate a comb on a surface: sea, wing, breath, or a file.py."),
]
RibbonsOption = Annotated[
    int | None, typer.Option(min=2, max=6, help="Emulated ribbons on the reference.  [default: 5]")
]
SeedOption = Annotated[int | None, typer.Option(min=0, help="Of the emulated noise.  [default: 0]")]
RateOption = Annotated[
    int | None,
    typer.Option(min=1, max=200, help="Scans a second.  [default: 100, or less if a ribbon cannot]"),
]
SecondsOption = Annotated[
    float | None, typer.Option(min=0.1, help="Stop after so long.  [default: at Ctrl-C]")
]
MethodOption = Annotated[str, typer.Option(help="Of curves: spline, or hermite, the paper's.")]
BaudOption = Annotated[int, typer.Option(min=1200, help="Speed of serial ports, bits a second.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object a line.")]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace a file that is there already.")]
RotateMibOption = Annotated[
    float | None,
    typer.Option("--rotate-mib", min=0.1, help="Record to FILE-001, -002 ..., each of so many MiB."),
]
RotateSOption = Annotated[
    float | None, typer.Option("--rotate-s", min=1.0, help="Record to FILE-001, -002 ..., each so long.")
]
