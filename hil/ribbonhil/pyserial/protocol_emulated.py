"""emulated://SCENE/INDEX?ribbons=5&seed=0&period_s=20&noise=1: a port of an emulated ribbon, for pyserial.

SCENE is a built-in scene or the percent-encoded path of a Python file; INDEX 0 is the reference ribbon. Ports
of the same parameters in one process belong to one comb. Options are the fields of CombSpec and LinkFaults.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ribbonhost.errors import LinkError, UsageError
from serial.serialutil import PortNotOpenError, SerialBase, SerialException

from ribbonhil.comb_spec import parse_url
from ribbonhil.emulator import Line, open_line

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer


class Serial(SerialBase):
    """Baud rate and the other line settings are taken and have no effect."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._line: Line | None = None
        super().__init__(*args, **kwargs)

    def open(self) -> None:
        """Raises ValueError for a URL that means nothing, SerialException if the ribbon is in use or gone."""
        if self.is_open:
            raise SerialException("the port is open already")
        if self.port is None:
            raise SerialException("a port must be given before it can be opened")
        try:
            address = parse_url(self.port)
            self._line = open_line(address.comb, address.index, address.faults)
        except UsageError as error:
            raise ValueError(str(error)) from error
        except LinkError as error:
            raise SerialException(str(error)) from error
        self.is_open = True

    def close(self) -> None:
        """Wakes a read that waits."""
        if self._line is not None:
            self.is_open = False
            self._line.close()
            self._line = None

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        return self._opened().waiting

    @property
    def out_waiting(self) -> int:
        """Nothing waits: the emulated link takes all bytes at once."""
        self._opened()
        return 0

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes; fewer after the timeout, or when cancelled.

        Raises SerialException if the ribbon is gone.
        """
        try:
            return self._opened().read(size, self.timeout)
        except LinkError as error:
            raise SerialException(str(error)) from error

    def write(self, b: ReadableBuffer, /) -> int:
        """Sends all bytes. Raises SerialException if the ribbon is gone."""
        content = bytes(b)
        try:
            self._opened().write(content)
        except LinkError as error:
            raise SerialException(str(error)) from error
        return len(content)

    def flush(self) -> None:
        """Returns at once: written bytes have arrived."""
        self._opened()

    def cancel_read(self) -> None:
        """Makes a read in another thread return."""
        if self._line is not None:
            self._line.cancel_read()

    def cancel_write(self) -> None:
        """Has nothing to cancel: writes do not wait."""

    def reset_input_buffer(self) -> None:
        """Discards what was received and not read."""
        self._opened().discard()

    def reset_output_buffer(self) -> None:
        """Has nothing to discard."""
        self._opened()

    def _opened(self) -> Line:
        if self._line is None:
            raise PortNotOpenError
        return self._line

    def _reconfigure_port(self) -> None:
        """Called by SerialBase when a setting changes."""

    def _update_break_state(self) -> None:
        """There is no break condition on the link."""

    def _update_rts_state(self) -> None:
        """There is no flow control on the link."""

    def _update_dtr_state(self) -> None:
        """There is no flow control on the link."""

    @property
    def cts(self) -> bool:
        """Always clear to send."""
        self._opened()
        return True

    @property
    def dsr(self) -> bool:
        """Always ready."""
        self._opened()
        return True

    @property
    def ri(self) -> bool:
        """Nobody calls."""
        self._opened()
        return False

    @property
    def cd(self) -> bool:
        """Whether the link is there."""
        return self._opened().is_connected()
