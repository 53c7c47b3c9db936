"""A board that runs MicroPython, as mpremote sees it: the unix port on a pseudo-terminal, emulated pins."""

import os
import pty
import select
import signal
import subprocess
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from ribbonhil.probe.emulated import EmulatedPins, Supply, environment, micropython, serve

RAW_REPL = b"raw REPL"
SOFT_REBOOT = b"OK\r\nMPY: soft reboot\r\n"
CTRL_C = b"\r\x03"
PROMPT = b">"
POLL_S = 0.05


class MicroPythonBoard:
    """`port`: what mpremote connects to; `said`: all that came from it.

    The unix port ends where a board starts anew, and is started again.
    """

    def __init__(self, pins: EmulatedPins) -> None:
        from_probe, self._to_pins = os.pipe()
        self._from_pins, to_probe = os.pipe()
        self._outer, slave = pty.openpty()
        self._inner, self._terminal = pty.openpty()
        tty.setraw(slave)
        tty.setraw(self._terminal)
        self.port = os.ttyname(slave)
        self.said = b""
        self._slave = slave
        self._ends = False
        self._python = self._start()
        self._threads = [
            threading.Thread(target=serve, args=(pins, from_probe, to_probe), daemon=True),
            threading.Thread(target=self._relay, daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    def _start(self) -> "subprocess.Popen[bytes]":
        return subprocess.Popen(
            [micropython()],
            env=environment(self._to_pins, self._from_pins, Supply()),
            pass_fds=(self._to_pins, self._from_pins),
            stdin=self._terminal,
            stdout=self._terminal,
            stderr=self._terminal,
            start_new_session=True,
        )

    def _relay(self) -> None:
        while not self._ends:
            if self._python.poll() is not None:
                self._restart()
            for source in select.select([self._outer, self._inner], [], [], POLL_S)[0]:
                data = os.read(source, 4096)
                if source == self._inner:
                    self.said += data
                    os.write(self._outer, data)
                else:
                    if data.startswith(CTRL_C) and not self.said.rstrip().endswith(PROMPT):
                        self._python.send_signal(signal.SIGINT)  # the unix port takes it so while it runs
                    os.write(self._inner, data)

    def _restart(self) -> None:
        """As a board after Ctrl-D in the raw REPL: the raw REPL again, and no greeting."""
        self._python = self._start()
        os.write(self._inner, b"\x01")
        seen = b""
        while RAW_REPL not in seen:
            seen += os.read(self._inner, 4096)
        os.write(self._outer, SOFT_REBOOT + seen[seen.index(RAW_REPL) :])

    def close(self) -> None:
        self._ends = True
        self._threads[1].join()
        self._python.kill()
        self._python.wait()
        for descriptor in (self._to_pins, self._from_pins):
            os.close(descriptor)
        self._threads[0].join()
        for descriptor in (self._outer, self._slave, self._inner, self._terminal):
            with suppress(OSError):
                os.close(descriptor)


@contextmanager
def micropython_board(pins: EmulatedPins) -> Iterator[MicroPythonBoard]:
    """A board for as long as the context lasts."""
    board = MicroPythonBoard(pins)
    try:
        yield board
    finally:
        board.close()
