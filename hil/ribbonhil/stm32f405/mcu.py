"""An STM32F405 that runs an image, in virtual time."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from ribbonhost.errors import RibbonError, UsageError

from ribbonhil.stm32f405.boards import BOARDS, Wiring, pin_number

try:
    from ribbonhil.stm32f405._mcu import ffi, lib
except ImportError as error:
    raise RibbonError(
        "The model of the STM32F405 is not built: type make firmware, or where there is no make"
        " pip install unicorn==2.1.4 && python -m ribbonhil.stm32f405.build"
    ) from error


BUFFER_BYTES = 65536
SLICE_NS = 50_000_000  # in which even 10 Mbit/s do not fill the buffer


class ImageError(UsageError):
    """The image cannot be run."""


class Stop(IntEnum):
    """Why a run came back."""

    AT_HORIZON = lib.MCU_AT_HORIZON
    RESET = lib.MCU_RESET
    POWER_CUT = lib.MCU_POWER_CUT
    BOOT_LOADER = lib.MCU_BOOT_LOADER
    LOCKUP = lib.MCU_LOCKUP


@dataclass(frozen=True)
class Options:
    """What can be chosen about the hardware around the image."""

    link_baud: int = 921_600
    half_cycles_per_instruction: int = 3  # 1.5 cycles, a little pessimistic
    erase_us: int = 250_000  # of a 16 KiB sector, typical; data sheet DS8626, table 40
    program_us: int = 16
    crystal_fails_us: int = 0  # 0: never
    temperature_c: float = 25.0
    unique_id: bytes = bytes(range(12))
    seed: int = 0


@dataclass(frozen=True)
class Counters:
    """What has happened since the start; the fields of `struct mcu_counters`."""

    instructions: int
    exceptions: int
    fp_frames: int
    sleeps: int
    bus_bytes: int
    bus_pulses: int
    link_bytes_sent: int
    link_bytes_lost: int
    link_bytes_unread: int
    resets: int
    watchdog_resets: int
    flash_operations: int
    violations: int
    sleep_ns: int
    hclk_hz: int
    spi_hz: int
    link_baud: int


@ffi.callback("uint8_t(void *, uint64_t, uint8_t)")  # type: ignore[untyped-decorator]
def _no_string_transfer(context: Any, t_ns: int, mosi: int) -> int:
    return 0xFF


@ffi.callback("void(void *, uint64_t, bool)")  # type: ignore[untyped-decorator]
def _no_string_clock(context: Any, t_ns: int, data: bool) -> None:
    pass


@dataclass(frozen=True)
class Bus:
    """The sensor string as addresses of C functions (as in host_bus) and their context."""

    transfer: int = int(ffi.cast("uintptr_t", _no_string_transfer))
    select_clock: int = int(ffi.cast("uintptr_t", _no_string_clock))
    context: int = 0


class Mcu:
    """One MCU on its board, powered on at time 0.

    Raises ImageError for an image that is empty or larger than the flash."""

    def __init__(
        self,
        image: bytes,
        wiring: Wiring = BOARDS["pyboard_v11"],
        bus: Bus | None = None,
        options: Options | None = None,
    ) -> None:
        if len(image) < 8:
            raise ImageError(f"The image has {len(image)} bytes: that is not even its vector table")
        options = options or Options()
        bus = bus or Bus()
        pins = {f.name: pin_number(getattr(wiring, f.name)) for f in fields(wiring) if f.type == "str"}
        c_wiring = ffi.new(
            "struct mcu_wiring *",
            {**pins, "link_usart": wiring.link_usart, "crystal_hz": wiring.crystal_hz},
        )
        c_options = ffi.new(
            "struct mcu_options *", {f.name: getattr(options, f.name) for f in fields(options)}
        )
        c_bus = ffi.new("struct mcu_bus *")
        c_bus.context = ffi.cast("void *", bus.context)
        c_bus.transfer = ffi.cast("uint8_t (*)(void *, uint64_t, uint8_t)", bus.transfer)
        c_bus.select_clock = ffi.cast("void (*)(void *, uint64_t, bool)", bus.select_clock)
        mcu = lib.mcu_new(image, len(image), c_wiring, c_options, c_bus)
        if mcu == ffi.NULL:
            raise ImageError(f"The image of {len(image)} bytes does not fit into 1 MiB of flash")
        self._mcu = ffi.gc(mcu, lib.mcu_free)
        self._buffer = ffi.new("uint8_t[]", BUFFER_BYTES)
        self._received = bytearray()
        self._log: Any = None
        self._profile: Any = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Frees the MCU; nothing else may be called afterwards."""
        ffi.release(self._mcu)

    @property
    def now_s(self) -> float:
        """Virtual seconds since power-on."""
        return float(lib.mcu_now_ns(self._mcu)) * 1e-9

    @property
    def next_event_s(self) -> float:
        """Virtual time at which a sleeping core has something to do or to send next; now if it is awake."""
        return float(lib.mcu_next_event_ns(self._mcu)) * 1e-9

    @property
    def is_sending(self) -> bool:
        """Whether bytes of the firmware are on their way to its host."""
        return bool(lib.mcu_is_sending(self._mcu))

    @property
    def device_us(self) -> int:
        """What the firmware's 32-bit microsecond timer shows."""
        return int(lib.mcu_device_us(self._mcu))

    def run_until(self, t_s: float, stop_at_reset: bool = False) -> Stop:
        """Runs to virtual time t_s, or to what `Stop` names."""
        end_ns = round(t_s * 1e9)
        stop = Stop.AT_HORIZON
        while stop == Stop.AT_HORIZON and (now_ns := lib.mcu_now_ns(self._mcu)) < end_ns:
            stop = Stop(lib.mcu_run(self._mcu, min(end_ns, now_ns + SLICE_NS), stop_at_reset))
            n = lib.mcu_link_read(self._mcu, self._buffer, BUFFER_BYTES)
            self._received += ffi.buffer(self._buffer, n)
        return stop

    def run_for(self, duration_s: float, stop_at_reset: bool = False) -> Stop:
        """Runs for a while of virtual time, or to what `Stop` names."""
        return self.run_until(self.now_s + duration_s, stop_at_reset)

    def power_on(self) -> None:
        """Takes power away and gives it back: RAM then holds anything, flash what it held."""
        lib.mcu_power_on(self._mcu)
        self._received.clear()

    def read(self) -> bytes:
        """Bytes that have left the link since the last call."""
        received = bytes(self._received)
        self._received.clear()
        return received

    def write(self, data: bytes) -> int:
        """Puts bytes on the way to the firmware; returns how many there was room for."""
        return int(lib.mcu_link_write(self._mcu, data, len(data)))

    @property
    def counters(self) -> Counters:
        """What has happened so far."""
        counters = ffi.new("struct mcu_counters *")
        lib.mcu_read_counters(self._mcu, counters)
        return Counters(**{f.name: int(getattr(counters, f.name)) for f in fields(Counters)})

    @property
    def violation(self) -> str:
        """The first thing the firmware did that the real part forbids, or an empty string."""
        return str(ffi.string(lib.mcu_violation(self._mcu)).decode())

    @property
    def led(self) -> bool:
        """Whether the LED is lit."""
        return bool(lib.mcu_led(self._mcu))

    def peek(self, address: int, n: int) -> bytes:
        """n bytes of memory. Raises ValueError where no memory is."""
        out = ffi.new("uint8_t[]", n)
        if not lib.mcu_peek(self._mcu, address, out, n):
            raise ValueError(f"no memory at {address:#x}")
        return bytes(ffi.buffer(out, n))

    def poke(self, address: int, data: bytes) -> None:
        """Changes memory, flash included. Raises ValueError where no memory is."""
        if not lib.mcu_poke(self._mcu, address, data, len(data)):
            raise ValueError(f"no memory at {address:#x}")

    def cut_power_in_flash_operation(self, operations: int) -> None:
        """Power fails in the middle of that flash operation from now on, 1 being the next."""
        lib.mcu_cut_power_in_flash_operation(self._mcu, operations)

    def start_profile(self) -> None:
        """Starts counting instructions by where they are."""
        self._profile = ffi.new("uint64_t[]", lib.MCU_PROFILE_COUNT)
        lib.mcu_profile(self._mcu, self._profile)

    def end_profile(self) -> NDArray[np.uint64]:
        """Ends counting: instructions of the blocks of code that begin at each halfword of flash."""
        lib.mcu_profile(self._mcu, ffi.NULL)
        return np.frombuffer(ffi.buffer(self._profile), np.uint64)

    def start_log(self, capacity: int) -> None:
        """Starts logging what the firmware does and sees outside of itself."""
        self._log = ffi.new("struct logged_event[]", capacity)
        lib.mcu_log_events(self._mcu, self._log, capacity)

    def end_log(self) -> tuple[Any, int]:
        """Ends logging: an array of `struct logged_event` and how many of it are filled."""
        n = int(lib.mcu_log_events(self._mcu, ffi.NULL, 0))
        log, self._log = self._log, None
        return log, n
