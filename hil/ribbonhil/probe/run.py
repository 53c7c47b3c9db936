"""Probes the sensor string on a board that runs MicroPython: python -m ribbonhil.probe.run, or make probe

Nothing is written to the board: it imports the compiled probe over USB, from a folder that mpremote mounts.
"""

import argparse
import contextlib
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from ribbonhost.errors import RibbonError, UsageError

from ribbonhil._firmware import lib
from ribbonhil.probe.build import build

USB_VENDOR = 0xF055
"""Of boards with MicroPython's own USB descriptor, the pyboard and the Feather among them."""

RELEASE_S = 20.0
INTERRUPTED = 130
FIRST_WORDS = "String of"
TRACEBACK = "Traceback"
PASSED, FAILED = "PASS", "FAIL"

NO_BOARD = (
    "No board that runs MicroPython is connected by USB{ports}. Connect one: a new pyboard has MicroPython "
    "on it, hil/probe/README.md says how to put it on any other. If its port is of another kind, type: "
    "make probe PORT=..."
)
NO_ANSWER = (
    "No MicroPython answers on {port}: put it on the board (hil/probe/README.md), press its reset button, "
    "and try again"
)
NOT_OPENED = (
    "{port} cannot be opened: it is not there, another program uses it, or you may not (on Linux type: "
    "sudo usermod -aG dialout $USER, and log in again)"
)
TOO_OLD = "MicroPython on the board is too old for this probe: 1.19 or newer is needed (hil/probe/README.md)"
BROKEN_OFF = "The probe broke off on the board: {reason}"


def find_port() -> str:
    """The port of the one board with MicroPython. Raises RibbonError if there is none, or more than one."""
    from serial.tools import list_ports

    ports = sorted(list_ports.comports())
    boards = [str(port.device) for port in ports if port.vid == USB_VENDOR]
    if not boards:
        others = ", ".join(str(port.device) for port in ports)
        raise RibbonError(NO_BOARD.format(ports=f" (ports: {others})" if others else ""))
    if len(boards) > 1:
        raise RibbonError(
            f"{len(boards)} boards run MicroPython: choose one with make probe PORT={'|'.join(boards)}"
        )
    return boards[0]


def mpremote(port: str, *commands: str) -> list[str]:
    """The command line of mpremote for a port."""
    return [sys.executable, "-m", "mpremote", "connect", port, *commands]


def _print_at_once(line: str) -> None:
    print(line, flush=True)


def probe(
    port: str, compiled: Path, slots: int, walk: bool, show: Callable[[str], None] = _print_at_once
) -> bool:
    """Runs the probe on a board and shows its lines as they come; whether it found no fault.

    Raises RibbonError if it did not get to a result.
    """
    code = f"import probe; probe.main({slots}, {walk})"
    process = subprocess.Popen(
        mpremote(port, "mount", str(compiled), "exec", code),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,  # Ctrl-C is not for mpremote, which would wait for the probe
    )
    assert process.stdout is not None
    result: bool | None = None
    is_of_probe = False
    others = []
    try:
        for line in map(str.rstrip, process.stdout):
            is_of_probe = line.startswith(FIRST_WORDS) or (is_of_probe and not line.startswith(TRACEBACK))
            if is_of_probe:
                show(line)
            else:
                others.append(line)
            if line.startswith((PASSED, FAILED)):
                result = line.startswith(PASSED)
    except BaseException:
        process.kill()
        raise
    finally:
        process.communicate()
    if result is None:
        raise RibbonError(_explain(others, port))
    return result


def _explain(lines: list[str], port: str) -> str:
    """Why there is no result, from what mpremote and MicroPython said."""
    text = "\n".join(lines)
    if "failed to access" in text:
        return NOT_OPENED.format(port=port)
    if "could not enter raw repl" in text:
        return NO_ANSWER.format(port=port)
    if "incompatible .mpy" in text:
        return TOO_OLD
    return BROKEN_OFF.format(reason=next((line for line in reversed(lines) if line), "it says nothing"))


def release(port: str) -> None:
    """Ends a probe that goes on by itself on the board, and frees its pins."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        subprocess.run(mpremote(port, "exec", "pass"), capture_output=True, timeout=RELEASE_S)


def main() -> int:
    """Returns the exit status: 0 if the string has no fault."""
    parser = argparse.ArgumentParser(prog="python -m ribbonhil.probe.run", description=__doc__)
    parser.add_argument("--port", help="of the board; found by itself if only one is connected")
    parser.add_argument("--board", default="pyboard_v11", help="pyboard_v11 (default) or feather_f405")
    parser.add_argument("--slots", type=int, default=lib.RIBBON_SLOT_COUNT, help="of the string")
    parser.add_argument("--walk", action="store_true", help="also check the order, with a magnet")
    arguments = parser.parse_args()
    port = arguments.port
    try:
        if arguments.slots < 1:
            raise UsageError(f"a string has 1 slot or more, not {arguments.slots}")
        compiled = build(arguments.board)
        port = port or find_port()
        return 0 if probe(port, compiled, arguments.slots, arguments.walk) else 1
    except RibbonError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        if port:
            release(port)
        print("Stopped.", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
