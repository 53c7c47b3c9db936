"""A sensor string on the bench: a test drives its select chain and SPI, and sets what is true."""

import numpy as np
from numpy.typing import NDArray
from ribbonhil._firmware import ffi, lib

READ = 0x80
BYTE_NS = 1600
LIS2DW12, MMC5983MA, HMC5983 = lib.WIRE_PART_LIS2DW12, lib.WIRE_PART_MMC5983MA, lib.WIRE_PART_HMC5983
S = 1_000_000_000
MS = 1_000_000
FOREVER_NS = 2**63
REJECTIONS = ("premature", "truncated", "read_only", "write_only", "address", "value", "busy", "not_modelled")


class StringBench:
    """t_ns: true time now. Transactions advance it by the bytes' time, `wait` by what it is told."""

    def __init__(
        self,
        *parts: int,
        specific_force_mps2: object = (0.0, 0.0, 9.80665),
        field_ut: object = (0.0, 20.0, -40.0),
        seed: int = 1,
        noise: float = 0.0,
        temperature_c: float = 25.0,
        step_s: float = 1.0,
        periodic: bool = False,
    ) -> None:
        """Truth vectors are (3,) for all slots and times, or (rows, 3) for all slots, step_s apart."""
        self.t_ns = 0
        self._slots = len(parts)
        rows = max(np.atleast_2d(specific_force_mps2).shape[0], np.atleast_2d(field_ut).shape[0])
        self._force = self._table(specific_force_mps2, rows)
        self._field = self._table(field_ut, rows)
        table = ffi.new("struct truth_table *")
        table.specific_force_mps2 = ffi.from_buffer("double[]", self._force)
        table.field_ut = ffi.from_buffer("double[]", self._field)
        table.rows, table.slots = rows, self._slots
        table.step_s, table.periodic = step_s, periodic
        config = ffi.new("struct sensor_bus_config *")
        config.seed, config.slots = seed, self._slots
        config.noise_scale, config.temperature.start_c = noise, temperature_c
        for slot, part in enumerate(parts):
            config.parts[slot] = part
        self.bus = ffi.new("struct sensor_bus *")
        assert lib.sensor_bus_init(self.bus, config, table) == 0

    def _table(self, value: object, rows: int) -> NDArray[np.float64]:
        vectors = np.broadcast_to(np.atleast_2d(np.asarray(value, dtype=np.float64)), (rows, 3))
        return np.ascontiguousarray(np.broadcast_to(vectors[:, None], (rows, self._slots, 3)))

    def wait(self, seconds: float) -> None:
        self.t_ns += round(seconds * 1e9)

    def clock(self, data: bool) -> None:
        lib.sensor_bus_select_clock(self.bus, self.t_ns, data)

    def select(self, slot: int | None) -> None:
        """Flushes the chain, then walks a single 0 to the slot; None leaves nothing selected."""
        for _ in range(self._slots):
            self.clock(True)
        if slot is not None:
            self.clock(False)
            for _ in range(slot):
                self.clock(True)

    def bytes(self, data: bytes) -> bytes:
        """Exchanges bytes with whatever is selected."""
        answer = bytearray()
        for byte in data:
            self.t_ns += BYTE_NS
            answer.append(lib.sensor_bus_transfer(self.bus, self.t_ns, byte))
        return bytes(answer)

    def transaction(self, slot: int, data: bytes) -> bytes:
        self.select(slot)
        answer = self.bytes(data)
        self.select(None)
        return answer

    def read(self, slot: int, address: int, count: int = 1) -> bytes:
        return self.transaction(slot, bytes([READ | address]) + bytes(count))[1:]

    def write(self, slot: int, address: int, *values: int) -> None:
        self.transaction(slot, bytes([address, *values]))

    def fault(
        self, kind: str, slot: int, start_ns: int = 0, end_ns: int = FOREVER_NS, parameter: float = 0
    ) -> None:
        fault = ffi.new("struct fault *")
        fault.kind, fault.slot = getattr(lib, f"FAULT_{kind.upper()}"), slot
        fault.start_ns, fault.end_ns, fault.parameter = start_ns, end_ns, parameter
        assert lib.fault_add(ffi.addressof(self.bus.faults), fault) == 0

    def force_at(self, t_s: float) -> NDArray[np.float64]:
        """Specific force of slot 0 as the models see it."""
        out = ffi.new("double[3]")
        lib.truth_table_specific_force(ffi.addressof(self.bus.truth), 0, t_s, out)
        return np.array(list(out))

    def rejected(self, slot: int) -> dict[str, int]:
        """What the part refused to do, by reason."""
        counts = self.bus.sensors[slot].counters.rejected
        return {name: counts[i] for i, name in enumerate(REJECTIONS) if counts[i]}
