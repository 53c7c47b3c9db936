"""What a ribbon in Python knows and says: its packets and its calibration record, without any behaviour."""

from __future__ import annotations

import math
import struct

import numpy as np
from ribbonhost import wire
from ribbonhost.framing import crc32
from ribbonhost.wire import Mode, Part, SlotReason

CLOCK_MODULUS = 2**32
SCAN_US = 3_000
START_SEQUENCE = 65_500


class RibbonState:
    """A ribbon at a moment of its own time; that of the host runs `clock_ratio` times slower."""

    slot_count = 32
    rate_max_hz = 200
    clock_ratio = 1.00002
    clock_start_us = CLOCK_MODULUS - 5_000_000
    """The 32-bit clock wraps five seconds into a run, so that each run passes a wrap."""
    power_on_us = 100_000
    """How long after the link was opened the device starts."""
    absent_slots: tuple[int, ...] = ()

    def __init__(self) -> None:
        self.t_us = 0
        self.rate_hz = min(100, self.rate_max_hz)
        self.mode = Mode.ORIENT
        self.sequence = START_SEQUENCE
        self.scans = 0
        self.overruns = 0
        self.frames_dropped = 0
        self.rx = {"rx_crc_errors": 0, "rx_malformed": 0, "rx_unknown": 0}
        self.errors = [0] * self.slot_count
        self.record = self.identity_record()
        self.calibration_sequence = 0
        self.held: tuple[np.ndarray, ...] = ()

    def clock_us(self) -> int:
        """The device's 32-bit clock."""
        return (self.clock_start_us + self.t_us) % CLOCK_MODULUS

    def period_us(self) -> int:
        return round(1e6 / self.rate_hz)

    # ------------------------------------------------------------ calibration

    def identity_record(self) -> bytes:
        matrix = np.tile(np.eye(3).ravel(), (self.slot_count, 1))
        slots = wire.SlotCalibrationArray(np.zeros((self.slot_count, 3)), matrix)
        return wire.Calibration(wire.CALIBRATION_LAYOUT, 2, 0, 0.025, 22.5, 42.4, slots).pack()

    def is_sound(self, record: bytes) -> bool:
        return (
            self.has_layout(record)
            and self.has_own_slots(record)
            and self.is_finite(record)
            and self.is_in_range(record)
        )

    def has_layout(self, record: bytes) -> bool:
        return record[:2] == b"\x01\x00"

    def has_own_slots(self, record: bytes) -> bool:
        return record[3] == self.slot_count

    def is_finite(self, record: bytes) -> bool:
        return bool(np.isfinite(np.frombuffer(record[8:], "<f4")).all())

    def is_in_range(self, record: bytes) -> bool:
        pitch_m, horizontal_ut, down_ut = struct.unpack_from("<fff", record, 8)
        return bool(
            record[2] in (2, 3)
            and np.float32(0.001) <= pitch_m <= 1.0
            and 1.0 <= horizontal_ut <= 100.0
            and -100.0 <= down_ut <= 100.0
        )

    # ------------------------------------------------------------ packets

    def parts(self) -> np.ndarray:
        parts = np.where(np.arange(self.slot_count) % 2 == 0, Part.LIS2DW12, Part.MMC5983MA)
        parts[list(self.absent_slots)] = Part.NONE
        return parts.astype(np.uint8)

    def info(self) -> wire.Info:
        parts = self.parts()
        lsb = np.choose(parts, [0.0, 0.244e-3 * 9.80665, 100.0 / 16384.0, 0.0])
        of_magnetometer = 7 if self.record[2] == 3 else 3
        axes = np.choose(parts, [0, 7, of_magnetometer, of_magnetometer]).astype(np.uint8)
        return wire.Info(
            wire_version=wire.WIRE_VERSION,
            oldest_host_version=wire.OLDEST_HOST_VERSION,
            schema_hash=wire.SCHEMA_HASH,
            firmware_version=b"\x01\x02\x03",
            board=wire.Board.HOST,
            unique_id=bytes(range(12)),
            pitch_m=struct.unpack_from("<f", self.record, 8)[0],
            rate_hz=self.rate_hz,
            rate_max_hz=self.rate_max_hz,
            mode=self.mode,
            calibration_sequence=self.calibration_sequence,
            calibration_crc32=crc32(self.record),
            node_count=self.slot_count // 2,
            slots=wire.SlotInfoArray(parts, axes, lsb),
        )

    def reasons(self) -> np.ndarray:
        reasons = np.zeros(self.slot_count, np.uint8)
        reasons[list(self.absent_slots)] = SlotReason.ABSENT
        return reasons

    def status(self) -> wire.Status:
        return wire.Status(
            t_us=self.clock_us(),
            uptime_s=(self.t_us - self.power_on_us) // 1_000_000,
            scans=self.scans,
            overruns=self.overruns,
            frames_dropped=self.frames_dropped,
            **self.rx,
            scan_us=SCAN_US,
            rate_hz=self.rate_hz,
            mode=self.mode,
            reset_cause=wire.ResetCause.POWER_ON,
            clock_source=wire.ClockSource.HOST,
            temperature_c=math.nan,
            fault_pc=0,
            fault_lr=0,
            fault_cfsr=0,
            slots=wire.SlotStatusArray(self.reasons(), np.array(self.errors, np.int32)),
            health=wire.SlotHealthArray(
                np.zeros(self.slot_count, np.uint8), np.full(self.slot_count, -128, np.int32)
            ),
        )

    def attitude(self) -> tuple[np.ndarray, ...]:
        """q_world_node (n, 4), valid (n,), quality (n,); the same objects for half a second."""
        if self.scans % 50 == 0 or not self.held:
            nodes = self.slot_count // 2
            turn_rad = 0.1 * np.arange(nodes) + 1e-6 * self.t_us
            q = np.zeros((nodes, 4))
            q[:, 0], q[:, 1], q[:, 2] = np.cos(turn_rad), np.sin(turn_rad), 0.3
            valid = self.reasons()[1::2] == SlotReason.OK
            self.held = (q, valid, np.where(valid, 6, 15).astype(np.uint8))
        return self.held

    def orient(self, t_us: int) -> wire.Packet:
        return wire.Orient(t_us, self.sequence, wire.NodeArray(*self.attitude()))

    def compact(self, t_us: int) -> wire.Packet:
        return wire.OrientCompact(t_us, self.sequence, wire.NodeCompactArray(*self.attitude()))

    def raw(self, t_us: int) -> wire.Packet:
        reasons = self.reasons()
        counts = (np.arange(3 * self.slot_count).reshape(-1, 3) * 80 + self.scans) % 8192
        return wire.Raw(
            t_us,
            self.sequence,
            wire.AccelRawArray(reasons[::2], counts[::2]),
            wire.MagRawArray(reasons[1::2], counts[1::2]),
            accel_age_us=15_500,
            accel_period_us=5_000,
            accel_span_us=25_000,
            mag_age_us=4_000,
            mag_period_us=0,
            mag_span_us=4_000,
        )
