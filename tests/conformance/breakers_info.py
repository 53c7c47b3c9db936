"""Responders that break a rule of INFO."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from conformance.responder import Responder
from conformance.rule_breakers import RuleBreakers, altered_array, put
from ribbonhost import wire
from ribbonhost.wire import AckCode

BREAKERS = RuleBreakers()
breaks, alters = BREAKERS.breaks, BREAKERS.alters


@breaks("get_info_sends_info", r"\['ACK'\]")
class InfoNotSent(Responder):
    def get_info(self, argument: int, data: bytes) -> Any:
        return AckCode.OK, 0, b""


@breaks("get_info_sends_info", r"\['INFO', 'ACK'\]")
class InfoBeforeItsAck(Responder):
    def get_info(self, argument: int, data: bytes) -> Any:
        self.send(self.info())
        return AckCode.OK, 0, b""


@breaks("info_repeats", "firmware_version")
class InfoWithACounter(Responder):
    asked = 0

    def info(self) -> wire.Info:
        self.asked += 1
        return dataclasses.replace(super().info(), firmware_version=bytes([1, 2, self.asked]))


@breaks("info_comes_at_start", "INFO first, saw Status")
class StatusAtStart(Responder):
    def start(self) -> None:
        self.send(self.status())


@breaks("info_comes_only_when_asked", "not asked for, saw one")
class InfoEachSecond(Responder):
    def status(self) -> wire.Status:
        self.send(self.info())
        return super().status()


@breaks("info_follows_rate_and_mode", "rate 100 Hz, mode 1")
class InfoOfTheStart(Responder):
    def info(self) -> wire.Info:
        return dataclasses.replace(super().info(), rate_hz=100, mode=wire.Mode.ORIENT)


@breaks("slot_lsb_fits_the_part", "lsb 0.00239[0-9]* in slot 0")
class LsbWithoutAPart(Responder):
    absent_slots = (0,)

    def info(self) -> wire.Info:
        info = super().info()
        return dataclasses.replace(info, slots=altered_array(info.slots, lsb=put(0, 0.00239)))


alters(
    "versions_are_consistent", "wire_version of 1 or more, saw 0", "info", lambda info, _: {"wire_version": 0}
)
alters(
    "versions_are_consistent",
    f"oldest_host_version <= {wire.WIRE_VERSION}, saw 0",
    "info",
    lambda info, _: {"oldest_host_version": 0},
)
alters(
    "schema_hash_is_of_the_version",
    f"{wire.SCHEMA_HASH ^ 1:08x}",
    "info",
    lambda info, _: {"schema_hash": info.schema_hash ^ 1},
)
alters("unique_id_is_unique", "0000", "info", lambda info, _: {"unique_id": bytes(12)})
alters("unique_id_is_unique", "ffff", "info", lambda info, _: {"unique_id": b"\xff" * 12})
alters("info_rate_is_in_range", "rate_max_hz 201", "info", lambda info, _: {"rate_max_hz": 201})
alters("info_rate_is_in_range", "rate_hz 0", "info", lambda info, _: {"rate_hz": 0})
alters("info_board_is_known", "saw 99", "info", lambda info, _: {"board": 99})
alters("info_pitch_is_in_range", "nan", "info", lambda info, _: {"pitch_m": math.nan})
alters("info_pitch_is_in_range", "25.0", "info", lambda info, _: {"pitch_m": 25.0})
alters("slots_are_pairs", "16 nodes for 32 slots.* saw 15", "info", lambda info, _: {"node_count": 15})
alters(
    "slots_are_pairs",
    "no magnetometer, saw at 0",
    "info",
    lambda info, _: {"slots": altered_array(info.slots, part=put(0, wire.Part.MMC5983MA))},
)
alters(
    "slot_parts_are_known",
    "part 77 in slot 4",
    "info",
    lambda info, _: {"slots": altered_array(info.slots, part=put(4, 77))},
)
alters(
    "slot_axes_are_legal",
    "axes 3 in slot 2",
    "info",
    lambda info, _: {"slots": altered_array(info.slots, axes=put(2, 3))},
)
alters(
    "slot_axes_are_legal",
    r"\[3, 7\]",
    "info",
    lambda info, _: {"slots": altered_array(info.slots, axes=put(3, 7))},
)
alters(
    "slot_lsb_fits_the_part",
    "lsb 1 in slot 5",
    "info",
    lambda info, _: {"slots": altered_array(info.slots, lsb=put(5, 1.0))},
)
