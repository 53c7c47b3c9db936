"""An emulated sensor string as its owner sees it: truth and faults in, counters out."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ribbonhil._firmware import ffi, lib
from ribbonhil.emulated_device import Device
from ribbonhil.faults import Fault
from ribbonhil.truth import RibbonTruth

NEVER_NS = 2**64 - 1
REJECTIONS = (
    "premature",
    "truncated",
    "read_only",
    "write_only",
    "reserved_address",
    "reserved_value",
    "busy",
    "not_modelled",
)
"""Why a part refused what the bus asked for, in the order of enum sensor_rejection."""


@dataclass(frozen=True)
class BusCounters:
    """What happened on a ribbon's sensor bus since power-up.

    conflicts: bytes transferred while two or more sensors were selected; first_ and last_conflict_s: when,
        NaN if never.
    samples: (S,) samples that each sensor took.
    rejected: for each slot, what its part refused to do, by reason (REJECTIONS); no entry for none.
    """

    bytes: int
    conflicts: int
    first_conflict_s: float
    last_conflict_s: float
    samples: tuple[int, ...]
    rejected: tuple[dict[str, int], ...]


class TruthTable:
    """A ribbon's truth as the models read it: `struct truth_table`, and the arrays that it points to."""

    def __init__(self, truth: RibbonTruth, slots: int) -> None:
        """Raises ValueError if the truth is not of so many slots."""
        shape = (len(truth.specific_force_mps2), slots, 3)
        self._arrays = [
            np.ascontiguousarray(a, dtype=np.float64) for a in (truth.specific_force_mps2, truth.field_ut)
        ]
        if any(a.shape != shape for a in self._arrays):
            raise ValueError(f"{truth.specific_force_mps2.shape[1]} slots of truth do not fit {slots} parts")
        self.pointer = ffi.new("struct truth_table *")
        self.pointer.specific_force_mps2 = ffi.from_buffer("double[]", self._arrays[0])
        self.pointer.field_ut = ffi.from_buffer("double[]", self._arrays[1])
        self.pointer.rows, self.pointer.slots = shape[:2]
        self.pointer.step_s, self.pointer.periodic = truth.step_s, truth.periodic


def fill_config(config: Any, device: Device) -> Any:
    """Sets a `struct sensor_bus_config` to the parts of a device.

    Returns what must be kept until a bus has been made of it. Raises ValueError for errors of other parts.
    """
    config.seed, config.slots = device.seed, len(device.parts)
    config.noise_scale = device.noise
    config.temperature.start_c, config.temperature.rise_c = device.temperature_c, device.warming_c
    config.temperature.time_s = device.warming_s
    config.parts[0 : len(device.parts)] = list(device.parts)
    if device.errors is None:
        return None
    content = np.concatenate(
        [
            device.errors.matrix.reshape(-1, 9),
            device.errors.total_bias,
            device.errors.scale_per_c,
            device.errors.bias_per_c,
        ],
        axis=1,
    )
    if len(content) != len(device.parts):
        raise ValueError(f"errors of {len(content)} slots do not fit {len(device.parts)} parts")
    errors = ffi.new("struct sensor_errors[]", len(content))
    ffi.buffer(errors)[:] = np.ascontiguousarray(content, dtype=np.float64).tobytes()
    config.errors = errors
    return errors


class SensorString:
    """The sensors of one ribbon: a `struct sensor_bus` that somebody else owns."""

    def __init__(self, bus: Any) -> None:
        self._bus = bus

    def add_fault(self, fault: Fault) -> None:
        """Adds a fault. Raises ValueError if it is none, or there are too many."""
        entry = ffi.new("struct fault *")
        entry.kind, entry.slot, entry.parameter = fault.kind, fault.slot, fault.parameter
        entry.start_ns = round(fault.start_s * 1e9)
        entry.end_ns = NEVER_NS if math.isinf(fault.end_s) else round(fault.end_s * 1e9)
        if lib.fault_add(ffi.addressof(self._bus, "faults"), entry) != 0:
            raise ValueError(
                f"{fault} ends before it starts, or {lib.FAULT_CAPACITY} faults are there already"
            )

    def counters(self) -> BusCounters:
        """What happened on the sensor bus so far."""
        counters = self._bus.counters
        sensors = [self._bus.sensors[slot].counters for slot in range(self._bus.chain.slots)]
        return BusCounters(
            bytes=counters.bytes,
            conflicts=counters.conflicts,
            first_conflict_s=counters.first_conflict_ns * 1e-9 if counters.conflicts else math.nan,
            last_conflict_s=counters.last_conflict_ns * 1e-9 if counters.conflicts else math.nan,
            samples=tuple(sensor.samples for sensor in sensors),
            rejected=tuple(
                {name: count for name, count in zip(REJECTIONS, sensor.rejected, strict=True) if count}
                for sensor in sensors
            ),
        )
