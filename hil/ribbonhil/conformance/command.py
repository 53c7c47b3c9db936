"""`ribbonhil conformance`: runs the suite against a device, or lists its checks."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from ribbonhost.errors import UsageError

if TYPE_CHECKING:
    from ribbonhil.conformance.check import Check
    from ribbonhil.conformance.runner import Report


def conformance(
    url: Annotated[
        str | None,
        typer.Argument(
            help="Port of the device: /dev/ttyACM0, COM5, socket://HOST:PORT, emulated://wing/0, or any "
            "other that pyserial opens.",
            show_default=False,
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Run this check, or this group of checks, only. May be repeated.", metavar="NAME"),
    ] = None,
    baud: Annotated[int, typer.Option(help="Speed of a serial port, bits a second.")] = 921_600,
    calibration_write: Annotated[
        bool,
        typer.Option(
            help="Also check what writes calibration records; the one in use is put back afterwards."
        ),
    ] = True,
    dfu: Annotated[
        bool, typer.Option("--dfu", help="Also check that enter_dfu leaves the firmware; runs last.")
    ] = False,
    list_: Annotated[bool, typer.Option("--list", help="List the checks as Markdown and end.")] = False,
    json_: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
) -> None:
    """Test any device against every rule of the protocol.

    Exits with 0 if no rule was seen broken, 1 if one was or nothing answers, 2 on wrong usage.
    """
    from rich.console import Console

    from ribbonhil.conformance.check import Permission
    from ribbonhil.conformance.link import SerialLink
    from ribbonhil.conformance.report import as_json, as_markdown, show
    from ribbonhil.conformance.runner import run

    checks = selected(only or [])
    if list_:
        print(as_markdown(checks), end="")
        return
    if url is None:
        raise UsageError("Which device? Name its port, for example: ribbonhil conformance /dev/ttyACM0")
    permitted = {Permission.ALWAYS}
    permitted |= {Permission.CALIBRATION_WRITE} if calibration_write else set()
    permitted |= {Permission.DFU} if dfu else set()
    link = SerialLink(url, baud)
    try:
        with Console(stderr=True).status("Looking for the device") as status:
            report = run(
                link, checks, permitted, on_start=lambda check: status.update(f"{check.group}: {check.name}")
            )
    finally:
        link.close()
    if json_:
        print(as_json(url, report))
    else:
        console = Console()
        show(url, report, console)
    tell_what_is_left(report)
    if not report.passed:
        raise typer.Exit(1)


def selected(names: list[str]) -> tuple[Check, ...]:
    """The checks of these names or groups, all if there is none. Raises UsageError for an unknown name."""
    from ribbonhil.conformance.checks import all_checks

    checks = all_checks()
    known = {name for check in checks for name in (check.name, check.group)}
    for name in names:
        if name not in known:
            raise UsageError(f"There is no check or group {name!r}: see `ribbonhil conformance --list`.")
    return tuple(check for check in checks if not names or check.name in names or check.group in names)


def tell_what_is_left(report: Report) -> None:
    """Says what the run could not put back, and saves a calibration record that is lost otherwise."""
    if report.left_changed:
        print(f"The device is not as it was: {report.left_changed}", file=sys.stderr)
    if report.unrestored_calibration:
        path = Path(f"calibration-{bytes(report.info.unique_id).hex()}.bin")
        try:
            path.write_bytes(report.unrestored_calibration)
            print(f"The calibration record that was in use is in {path}.", file=sys.stderr)
        except OSError as error:
            record = report.unrestored_calibration.hex()
            print(
                f"{path} cannot be written ({error.strerror}). The record in use was {record}",
                file=sys.stderr,
            )
