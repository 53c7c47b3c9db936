"""One emulated ribbon in virtual time: the firmware, its sensors, and the bytes between it and a host."""

from collections.abc import Sequence

from ribbonhost.errors import UsageError

from ribbonhil._firmware import ffi, lib
from ribbonhil.disturbances import Disturbance
from ribbonhil.emulated_device import Device, drawn_device
from ribbonhil.faults import Fault
from ribbonhil.handling import Handling
from ribbonhil.scenes import Scene
from ribbonhil.sensor_string import BusCounters, SensorString, TruthTable, fill_config
from ribbonhil.truth import Field, RibbonTruth
from ribbonhil.world import load_world, world_truth

__all__ = ["Device", "EmulatedRibbon", "drawn_device"]

READ_BYTES = 65536


class EmulatedRibbon:
    """A ribbon on a scene, powered up at true time 0. The same arguments give the same bytes.

    Time passes in run_until only. Not for several threads at once.
    """

    def __init__(
        self,
        scene: str | Scene | Handling = "wing",
        index: int = 0,
        *,
        ribbons: int = 5,
        seed: int = 0,
        period_s: float | None = None,
        noise: float = 1.0,
        field: Field | None = None,
        part_errors: int | None = None,
        warming_c: float = 0.0,
        disturbances: Sequence[Disturbance] = (),
    ) -> None:
        """Ribbon `index` of a comb of `ribbons`; 0 is the reference.

        part_errors, warming_c: see drawn_device.

        Raises SceneError or UsageError for a comb that cannot be.
        """
        if not 0 <= index <= ribbons:
            raise UsageError(
                f"a comb of {ribbons} ribbons has the numbers 0 (reference) to {ribbons}, not {index}"
            )
        devices = [
            drawn_device(seed, i, noise=noise, part_errors=part_errors, warming_c=warming_c)
            for i in range(ribbons + 1)
        ]
        world = load_world(scene, period_s) if isinstance(scene, str) else scene
        truth = world_truth(world, ribbons, field or Field(), devices=devices, disturbances=disturbances)
        self._start(truth.ribbon(index), devices[index])

    @classmethod
    def from_truth(cls, truth: RibbonTruth, device: Device) -> "EmulatedRibbon":
        """A ribbon whose sensors feel a given table, with as many slots as that has.

        Raises ValueError if the table and the parts do not fit together.
        """
        ribbon = cls.__new__(cls)
        ribbon._start(truth, device)
        return ribbon

    def _start(self, truth: RibbonTruth, device: Device) -> None:
        self.device = device
        self._truth = TruthTable(truth, len(device.parts))
        config = ffi.new("struct emulated_ribbon_config *")
        errors = fill_config(config.bus, device)
        config.clock_ppm, config.clock_offset_us = device.clock_ppm, device.clock_offset_us
        config.baud, config.unique_id = device.baud, list(device.unique_id)
        ribbon = lib.emulated_ribbon_new(config, self._truth.pointer)
        del errors  # copied
        if ribbon == ffi.NULL:
            raise ValueError("no ribbon can be made of these parts")
        self._ribbon = ffi.gc(ribbon, lib.emulated_ribbon_free)
        self._string = SensorString(lib.emulated_ribbon_bus(ribbon))
        self._buffer = ffi.new("uint8_t[]", READ_BYTES)

    @property
    def now_s(self) -> float:
        """True time that the ribbon got to: as run_until was told, or the end of the scan it was in then."""
        return float(lib.emulated_ribbon_now_ns(self._ribbon)) * 1e-9

    @property
    def next_event_s(self) -> float:
        """True time of the next thing to do or to read."""
        return float(lib.emulated_ribbon_next_event_ns(self._ribbon)) * 1e-9

    @property
    def is_sending(self) -> bool:
        """Whether bytes are on their way to the host."""
        return bool(lib.emulated_ribbon_is_sending(self._ribbon))

    @property
    def device_us(self) -> int:
        """What the device's 32-bit clock shows now."""
        return int(lib.emulated_ribbon_device_us(self._ribbon))

    def run_until(self, t_s: float) -> None:
        """Lets time pass until t_s; nothing happens if that is in the past."""
        lib.emulated_ribbon_run_until(self._ribbon, round(t_s * 1e9))

    def write(self, data: bytes) -> int:
        """Bytes toward the device, which arrive now; returns how many it had room for."""
        return int(lib.emulated_ribbon_write(self._ribbon, data, len(data)))

    def read(self) -> bytes:
        """All bytes that have left the device and were not read yet."""
        chunks = []
        while count := lib.emulated_ribbon_read(self._ribbon, self._buffer, READ_BYTES):
            chunks.append(ffi.buffer(self._buffer, count)[:])
        return b"".join(chunks)

    def add_fault(self, fault: Fault) -> None:
        """Adds a fault. Raises ValueError if it is none, or there are too many."""
        self._string.add_fault(fault)

    def feel(self, truth: RibbonTruth) -> None:
        """The world changes: the sensors feel this table now. Raises ValueError if it does not fit."""
        table = TruthTable(truth, len(self.device.parts))
        lib.sensor_bus_set_truth(lib.emulated_ribbon_bus(self._ribbon), table.pointer)
        self._truth = table

    def counters(self) -> BusCounters:
        """What happened on the sensor bus so far."""
        return self._string.counters()
