"""`ribbonhost recover`, and what is asked when a torn recording is opened."""

import json
import sys
from pathlib import Path

from ribbonhost.cli.progress import progress_bar
from ribbonhost.errors import RecordingError
from ribbonhost.record import Recovered, is_complete, recover


def run_recover(path: Path, output: Path | None, as_json: bool) -> None:
    """Makes a file whole and says what was saved. Raises RecordingError."""
    was_complete = is_complete(path)
    with progress_bar("recover") as progress:
        saved = recover(path, output, progress)
    if as_json:
        print(
            json.dumps(
                {
                    "recovered": {
                        "file": str(output or path),
                        "was_complete": was_complete,
                        "messages": saved.messages,
                        "seconds": round(saved.seconds, 3),
                        "damaged": saved.damaged,
                        "bytes_before": saved.bytes_before,
                        "bytes_after": saved.bytes_after,
                    }
                }
            )
        )
        return
    print(f"{output or path}: {_said(saved)}{', which was whole before' if was_complete else ''}")


def offer_recovery(path: Path) -> None:
    """Asks, where somebody can answer, whether a torn recording shall be made whole.

    Raises RecordingError, saying what to type, if it stays torn.
    """
    if is_complete(path):
        return
    torn = f"{path} was not closed: its writing was cut off"
    if sys.stdin.isatty() and sys.stderr.isatty():
        print(f"{torn}. Make it whole? [Y/n] ", end="", file=sys.stderr, flush=True)
        if sys.stdin.readline().strip().lower() in ("", "y", "yes"):
            with progress_bar("recover") as progress:
                saved = recover(path, on_progress=progress)
            print(f"{path}: {_said(saved)}", file=sys.stderr)
            return
    raise RecordingError(f"{torn}; type `ribbonhost recover {path}`, then try again")


def _said(saved: Recovered) -> str:
    left_out = f", {saved.damaged} damaged pieces left out" if saved.damaged else ""
    return f"{saved.messages} messages over {saved.seconds:.1f} s{left_out}"
