"""One ribbon in virtual time: the image that is flashed in an STM32F405, wired to emulated sensors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ribbonhil._firmware import ffi, lib
from ribbonhil.emulated_device import Device
from ribbonhil.faults import Fault
from ribbonhil.sensor_string import BusCounters, SensorString, TruthTable, fill_config
from ribbonhil.stm32f405.boards import BOARDS, Wiring, check_board
from ribbonhil.stm32f405.elf import read_image
from ribbonhil.stm32f405.mcu import Bus, Mcu, Options
from ribbonhil.truth import RibbonTruth


def image_ribbon(image: str, board: str, truth: RibbonTruth, device: Device) -> ImageRibbon:
    """A ribbon that runs the image in a file. Raises UsageError for an image or a board that is none."""
    check_board(board)
    return ImageRibbon(read_image(Path(image)), truth, device, BOARDS[board])


def _address(function: str) -> int:
    return int(ffi.cast("uintptr_t", ffi.addressof(lib, function)))


class ImageRibbon:
    """A ribbon that runs an image, powered up at true time 0: the same face as EmulatedRibbon.

    Its crystal is exact: the clock_ppm and clock_offset_us of the device do not apply.
    """

    def __init__(
        self,
        image: bytes,
        truth: RibbonTruth,
        device: Device | None = None,
        wiring: Wiring = BOARDS["pyboard_v11"],
        options: Options | None = None,
    ) -> None:
        """Raises ImageError for an image that cannot be run, ValueError if truth and parts do not fit."""
        self.device = device or Device()
        self._truth = TruthTable(truth, len(self.device.parts))
        config = ffi.new("struct sensor_bus_config *")
        errors = fill_config(config, self.device)
        self._bus = ffi.new("struct sensor_bus *")
        if lib.sensor_bus_init(self._bus, config, self._truth.pointer) != 0:
            raise ValueError("no sensor string can be made of these parts")
        del errors  # copied
        self._string = SensorString(self._bus)
        bus = Bus(
            transfer=_address("sensor_bus_transfer"),
            select_clock=_address("sensor_bus_select_clock"),
            context=int(ffi.cast("uintptr_t", self._bus)),
        )
        fitted = replace(
            options or Options(),
            link_baud=self.device.baud,
            temperature_c=self.device.temperature_c,
            unique_id=self.device.unique_id,
        )
        self.mcu = Mcu(image, wiring, bus, fitted)

    @property
    def now_s(self) -> float:
        """True time that the ribbon got to."""
        return self.mcu.now_s

    @property
    def next_event_s(self) -> float:
        """True time of the next thing to do or to read."""
        return self.mcu.next_event_s

    @property
    def is_sending(self) -> bool:
        """Whether bytes are on their way to the host."""
        return self.mcu.is_sending

    @property
    def device_us(self) -> int:
        """What the device's 32-bit clock shows now."""
        return self.mcu.device_us

    def run_until(self, t_s: float) -> None:
        """Lets time pass until t_s; nothing happens if that is in the past."""
        self.mcu.run_until(t_s)

    def write(self, data: bytes) -> int:
        """Bytes toward the device, sent at its baud rate; returns how many there was room for."""
        return self.mcu.write(data)

    def read(self) -> bytes:
        """All bytes that have left the device and were not read yet."""
        return self.mcu.read()

    def add_fault(self, fault: Fault) -> None:
        """Adds a fault. Raises ValueError if it is none, or there are too many."""
        self._string.add_fault(fault)

    def feel(self, truth: RibbonTruth) -> None:
        """The world changes: the sensors feel this table now. Raises ValueError if it does not fit."""
        table = TruthTable(truth, len(self.device.parts))
        lib.sensor_bus_set_truth(self._bus, table.pointer)
        self._truth = table

    def counters(self) -> BusCounters:
        """What happened on the sensor bus so far."""
        return self._string.counters()
