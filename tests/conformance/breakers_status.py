"""Responders that break a rule of STATUS."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from conformance.responder import Responder
from conformance.rule_breakers import RuleBreakers, altered_array, put
from ribbonhost import wire
from ribbonhost.wire import AckCode, Mode

BREAKERS = RuleBreakers()
breaks, alters = BREAKERS.breaks, BREAKERS.alters


@breaks("get_status_sends_status", "a STATUS after the ACK, saw none")
class StatusNotSent(Responder):
    def get_status(self, argument: int, data: bytes) -> Any:
        return AckCode.OK, 0, b""


@breaks("status_comes_once_a_second", "saw 1.500 s")
class StatusTooSeldom(Responder):
    def run_event(self) -> None:
        if self.powered and self.t_us >= self.status_due_us:
            self.status_due_us += 500_000
        super().run_event()


@breaks("status_comes_once_a_second", "0 in mode 0")
class NoStatusWhenQuiet(Responder):
    def run_event(self) -> None:
        if self.mode == Mode(0) and self.t_us >= self.status_due_us:
            self.status_due_us += 1_000_000
        else:
            super().run_event()


@breaks("counters_never_go_back", "errors of slot 0 not to fall")
class SlotErrorsReset(Responder):
    def status(self) -> wire.Status:
        status = super().status()
        errors = np.full(self.slot_count, 100 - status.uptime_s, np.int32)
        return dataclasses.replace(status, slots=dataclasses.replace(status.slots, errors=errors))


@breaks("scans_are_counted", "in mode 0, saw")
class ScansNotCountedWhenQuiet(Responder):
    quiet = 0

    def scan(self) -> None:
        super().scan()
        self.quiet = self.quiet + 1 if self.mode == Mode(0) else 0

    def status(self) -> wire.Status:
        return dataclasses.replace(super().status(), scans=self.scans - max(0, self.quiet - 100))


@breaks("slot_reasons_are_legal", "ok in 6")
class AbsentSlotIsOkInStatus(Responder):
    absent_slots = (6,)

    def status(self) -> wire.Status:
        status = super().status()
        return dataclasses.replace(status, slots=altered_array(status.slots, reason=put(6, 0)))


alters("counters_never_go_back", "scans not to fall", "status", lambda s, _: {"scans": 10_000 - s.scans})
alters(
    "counters_never_go_back",
    "rx_unknown not to fall",
    "status",
    lambda s, r: {"rx_unknown": 1_000 - s.uptime_s},
)
alters(
    "scans_are_counted",
    "scans to rise by 3[0-9]+ in mode 5, saw 6[0-9]+",
    "status",
    lambda s, _: {"scans": 2 * s.scans},
)
alters("uptime_follows_the_clock", "saw 3[0-9]{3}", "status", lambda s, r: {"uptime_s": r.t_us // 1_000})
alters("status_follows_rate_and_mode", "rate 100 Hz", "status", lambda s, _: {"rate_hz": 100})
alters("status_follows_rate_and_mode", "mode 1", "status", lambda s, _: {"mode": Mode.ORIENT})
alters("scan_time_fits_the_rate", "a scan to take time, saw 0", "status", lambda s, _: {"scan_us": 0})
alters("scan_time_fits_the_rate", "less than 10000 us, saw 60000", "status", lambda s, _: {"scan_us": 60_000})
alters(
    "slots_are_as_many_as_in_info",
    "32 slots, saw 30",
    "status",
    lambda s, _: {"slots": wire.SlotStatusArray(s.slots.reason[:30], s.slots.errors[:30])},
)
alters(
    "slot_reasons_are_legal",
    "99 in slot 3",
    "status",
    lambda s, _: {"slots": altered_array(s.slots, reason=put(3, 99))},
)
alters("status_enumerations_are_known", "saw 99", "status", lambda s, _: {"reset_cause": 99})
alters("status_enumerations_are_known", "saw 98", "status", lambda s, _: {"clock_source": 98})
alters("fault_record_needs_a_fault", "08001234", "status", lambda s, _: {"fault_pc": 0x08001234})
alters("temperature_is_possible", "200 degC", "status", lambda s, _: {"temperature_c": 200.0})
alters(
    "health_is_of_all_slots_or_none",
    "saw 30",
    "status",
    lambda s, _: {"health": wire.SlotHealthArray(s.health.misfit[:30], s.health.length_permille[:30])},
)
alters(
    "health_is_of_all_slots_or_none",
    "128",
    "status",
    lambda s, _: {"health": altered_array(s.health, misfit=put(5, 128))},
)
alters(
    "slots_without_readings_are_not_judged",
    "no misfit in slot 2, saw 1",
    "status",
    lambda s, _: {
        "slots": altered_array(s.slots, reason=put(2, 5)),
        "health": altered_array(s.health, misfit=put(2, 1)),
    },
)
