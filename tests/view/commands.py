"""Commands with a page, and browsers for them."""

import json
import os
import queue
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

COMMAND = [sys.executable, "-c", "from ribbonhost.cli import main; main()"]
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome") or "chromium"
FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
"""The picture is drawn by software, and the browser itself asks nobody anything."""


class Running:
    """A command that runs, and the JSON lines that it prints.

    Attributes:
        url: of its page.
        lines: all that it printed so far.
    """

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        self.lines: list[dict[str, Any]] = []
        self._queue: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()
        self.url = ""
        while not self.url:
            note = self.next().get("note", "")
            self.url = note.removeprefix("view: ") if note.startswith("view: http") else ""

    def next(self) -> dict[str, Any]:
        """The next line; fails if none comes in a minute."""
        text = self._queue.get(timeout=60)
        assert text, f"ended early: {self.lines[-3:]} {self.process.stderr and self.process.stderr.read()}"
        self.lines.append(json.loads(text))
        return self.lines[-1]

    def wait_for(self, key: str) -> dict[str, Any]:
        """The next line with this key."""
        while key not in (line := self.next()):
            pass
        return line

    def stop(self) -> list[dict[str, Any]]:
        """Ends it as Ctrl-C does; all lines."""
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(timeout=60) == 0
        while text := self._queue.get(timeout=10):
            self.lines.append(json.loads(text))
        return self.lines

    def _read(self) -> None:
        assert self.process.stdout
        for text in self.process.stdout:
            self._queue.put(text)
        self._queue.put("")


@contextmanager
def running(folder: Path, *arguments: object) -> Iterator[Running]:
    """`ribbonhost` with a page on a free port, in a folder."""
    # As on a machine without a display: no browser opens by itself.
    hidden = {name: text for name, text in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [*COMMAND, *map(str, arguments), "--view", "--view-port", "0", "--json"]
    with subprocess.Popen(
        command, cwd=folder, env=hidden, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield Running(process)
        finally:
            process.kill()
