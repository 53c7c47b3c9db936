"""`ribbonhil check`: holds a ribbon to what it must do, the same way whatever it is."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from ribbonhost.errors import RibbonError, UsageError
from ribbonhost.link import BAUD, EMULATOR_SCHEME
from ribbonhost.wire import INFO_RATE_MAX_HZ_RANGE

if TYPE_CHECKING:
    from ribbonhil.check.check import Check
    from ribbonhil.check.provoke import Provoker
    from ribbonhil.conformance.device import Device


PIPED_COLUMNS = 160
"""Wide enough for a row to stand on one line where there is no terminal to fit."""


def check(
    link: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="Port of the ribbon: /dev/ttyACM0, COM5, socket://HOST:PORT, emulated://rest/0, or any "
            "other that pyserial opens.",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            help="Run this check, or the checks of this topic, only. May be repeated.", metavar="NAME"
        ),
    ] = None,
    seconds: Annotated[float, typer.Option(min=0.5, max=600, help="How long each recording is.")] = 5.0,
    rates: Annotated[
        str | None,
        typer.Option(metavar="HZ,HZ", help="Rates to test.  [default: 100 and the device's largest]"),
    ] = None,
    straight: Annotated[
        bool, typer.Option("--straight", help="The ribbon lies along a straight edge: check that too.")
    ] = False,
    interactive: Annotated[
        bool, typer.Option("--interactive", help="You make the faults: you are asked to pull a wire.")
    ] = False,
    faults: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Where `ribbonhil serve --faults` takes faults."),
    ] = None,
    baud: Annotated[int, typer.Option(min=1200, help="Speed of the ribbon's UART, bits a second.")] = BAUD,
    json_: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
    report_file: Annotated[
        Path | None, typer.Option("--report", metavar="FILE", help="Also write that JSON object to a file.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the report if it is there.")] = False,
    list_: Annotated[bool, typer.Option("--list", help="List the checks as Markdown and end.")] = False,
) -> None:
    """Check rate, jitter, loss, ids, noise, static pose and fault reaction of a ribbon at rest.

    The same checks run on the firmware as a module, on the image in an emulated MCU, and on hardware, and the
    report says which of them it was. Exits with 0 if nothing failed, 1 if something did or nothing answers,
    2 on wrong usage. What was not run is told, and is no pass.
    """
    from rich.console import Console

    from ribbonhil.check import report
    from ribbonhil.check.bench import Bench, Options, PingedDevice
    from ribbonhil.check.runner import run
    from ribbonhil.conformance import link as links
    from ribbonhil.ran_on import RanOn

    checks = selected(only or [])
    if list_:
        print(report.as_markdown(checks), end="")
        return
    if link is None:
        raise UsageError("Which ribbon? Name its port, for example: ribbonhil check --link /dev/ttyACM0")
    if report_file is not None and report_file.exists() and not force:
        raise UsageError(f"{report_file} is there already: --force replaces it")
    with ExitStack() as stack:
        provoker = _provoker(link, interactive, faults, stack)
        opened = links.SerialLink(link, baud)
        stack.callback(opened.close)
        device = PingedDevice(opened)
        options = Options(seconds, _rates(rates), straight, _baud(link, baud))
        with Console(stderr=True).status("Looking for the device") as status:
            device.start()
            if interactive:
                status.stop()  # it would write over what the person is asked to do
            found = run(
                Bench(device, options, provoker(device) if provoker else None),
                checks,
                on_start=lambda one: status.update(f"{one.topic}: {one.name}"),
            )
    ran_on = RanOn(link, found.info)
    text = report.as_json(ran_on, found)
    if json_:
        print(text)
    else:
        report.show(ran_on, found, Console(width=None if sys.stdout.isatty() else PIPED_COLUMNS))
    if report_file is not None:
        try:
            report_file.write_text(f"{text}\n", encoding="utf-8")
        except OSError as error:
            raise RibbonError(f"{report_file} cannot be written: {error.strerror}") from error
    if not found.passed:
        raise typer.Exit(1)


def selected(names: list[str]) -> tuple[Check, ...]:
    """The checks of these names or topics, all if there is none. Raises UsageError for an unknown name."""
    from ribbonhil.check.runner import topics

    checks = tuple(one for topic in topics() for one in topic.checks)
    known = {name for one in checks for name in (one.name, one.topic)}
    for name in names:
        if name not in known:
            raise UsageError(f"there is no check or topic {name!r}: see `ribbonhil check --list`")
    return tuple(one for one in checks if not names or one.name in names or one.topic in names)


def _provoker(
    url: str, interactive: bool, faults: str | None, stack: ExitStack
) -> Callable[[Device], Provoker] | None:
    """What makes the provoker once the device is known; None if nothing can make faults."""
    from ribbonhil.check import provoke
    from ribbonhil.fault_port import FaultClient

    if interactive:
        if not sys.stdin.isatty():
            raise UsageError("--interactive asks somebody to press Enter: it needs a terminal")
        return lambda device: provoke.Person()
    if faults is not None:
        client = stack.enter_context(FaultClient(faults))
        return lambda device: provoke.Injector(client.injector(bytes(device.info.unique_id).hex()))
    if url.startswith(EMULATOR_SCHEME):
        comb = stack.enter_context(provoke.comb_of(url))
        return lambda device: provoke.injector_of(url, comb)
    return None


def _rates(text: str | None) -> tuple[int, ...]:
    low, high = INFO_RATE_MAX_HZ_RANGE
    try:
        rates_hz = tuple(int(word) for word in text.split(",")) if text is not None else ()
    except ValueError:
        rates_hz = (0,)
    if not all(low <= rate_hz <= high for rate_hz in rates_hz):
        raise UsageError(f"--rates {text} must be numbers from {low} to {high} with commas: --rates 50,100")
    return rates_hz


def _baud(url: str, baud: int) -> int:
    """The speed of the device's UART, which says what fits through it."""
    from ribbonhil.comb_spec import parse_url

    return parse_url(url).comb.baud if url.startswith(EMULATOR_SCHEME) else baud
