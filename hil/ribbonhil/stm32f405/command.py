"""The command `ribbonhil run`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from ribbonhil.stm32f405.boards import BOARDS


def run(
    image: Annotated[Path, typer.Argument(metavar="IMAGE", help="ribbon.bin or ribbon.elf.")],
    scene: Annotated[str, typer.Option(help="Surface: sea, wing, breath, or a Python file.")] = "wing",
    frames: Annotated[int, typer.Option(min=1, help="Scans to measure over.")] = 500,
    rate: Annotated[
        int | None, typer.Option(min=1, max=200, help="Scans a second.  [default: the firmware's own]")
    ] = None,
    ribbon: Annotated[int, typer.Option(min=0, max=6, help="Of the comb; 0: the reference.")] = 1,
    ribbons: Annotated[int, typer.Option(min=2, max=6, help="Ribbons on the reference.")] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Of noise and serial number.")] = 0,
    noise: Annotated[float, typer.Option(min=0.0, help="Times the noise of the parts' data sheets.")] = 1.0,
    part_errors: Annotated[
        int | None,
        typer.Option(min=0, metavar="SEED", help="Errors of parts off the shelf.  [default: none]"),
    ] = None,
    period: Annotated[
        float | None, typer.Option(min=0.01, help="Seconds of one period of the motion.")
    ] = None,
    logged: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Instead of a scene: an NPZ file of what a real sensor recorded."),
    ] = None,
    axes: Annotated[
        int | None,
        typer.Option(min=2, max=3, help="Of the magnetometers.  [default: the firmware's own]"),
    ] = None,
    profile: Annotated[
        bool, typer.Option(help="Count instructions by function; IMAGE must be the ELF file.")
    ] = False,
    board: Annotated[str, typer.Option(help=f"What the image was built for: {', '.join(BOARDS)}.")] = next(
        iter(BOARDS)
    ),
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
) -> None:
    """Run the image that is flashed, byte for byte, in an emulated STM32F405 on emulated sensors.

    With --logged every slot sees the same recorded sensor: arrays t_s (T), acc_mps2 (T, 3), mag_ut (T, 3),
    and q_world_sensor (T, 4) if the error is to be told.
    """
    from ribbonhil.stm32f405.boards import check_board

    check_board(board)
    if logged is not None:
        from ribbonhil.stm32f405.logged import read_log, run_log

        _print(asdict(run_log(image, read_log(logged), axes, board)), as_json)
        return
    from ribbonhil.stm32f405.run import RunOptions
    from ribbonhil.stm32f405.run import run as run_image

    report = run_image(
        RunOptions(
            image,
            scene,
            frames,
            rate,
            board,
            ribbons,
            ribbon,
            seed,
            noise,
            period,
            axes,
            profile,
            part_errors,
        )
    )
    told = asdict(report)
    if not profile:
        del told["instructions_by_function"]
    _print(told, as_json)
    sys.exit(0 if report.is_good else 1)


def _print(report: dict[str, object], as_json: bool) -> None:
    if as_json:
        print(json.dumps(report))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table(show_header=False, title="emulated STM32F405")
    for name, value in report.items():
        if isinstance(value, dict):
            for function, count in value.items():
                if count > 0:
                    table.add_row(function, str(count))
        elif value not in ("", None):
            table.add_row(name.replace("_", " "), str(value))
    Console().print(table)
