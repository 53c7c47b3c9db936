"""Responders that break a rule of ORIENT, ORIENT_COMPACT, RAW, rates or modes."""

from __future__ import annotations

from typing import Any

import numpy as np
from conformance.responder import Responder
from conformance.rule_breakers import RuleBreakers, altered_array, put
from ribbonhost import wire
from ribbonhost.wire import AckCode, Mode

BREAKERS = RuleBreakers()
breaks, alters = BREAKERS.breaks, BREAKERS.alters

FIRST_NODE = 8
HALF_TURN_45_DEG = np.sqrt(0.5)


@breaks("sequence_counts_scans", r"saw sequence \+ 0")
class SequenceStandsStill(Responder):
    def scan(self) -> None:
        self.sequence -= self.scans % 50 == 0
        super().scan()


@breaks("sequence_counts_scans", "at most 0 scans missing.* saw [1-9]")
class LosesScansUncounted(Responder):
    def send(self, packet: wire.Packet) -> None:
        if not (isinstance(packet, wire.Orient | wire.Raw) and self.scans % 50 == 0):
            super().send(packet)


alters("orient_and_raw_share_the_scan", "in ORIENT", "raw", lambda raw, _: {"t_us": (raw.t_us + 1) % 2**32})
alters(
    "orient_and_raw_share_the_scan",
    "in one of them only",
    "raw",
    lambda raw, _: {"sequence": (raw.sequence + 300) % 65_536},
)


@breaks("orient_comes_before_raw", "saw after it")
class RawFirst(Responder):
    def orient(self, t_us: int) -> Any:
        return super().raw(t_us) if Mode.RAW in self.mode else super().orient(t_us)

    def raw(self, t_us: int) -> Any:
        return super().orient(t_us) if Mode.ORIENT in self.mode else super().raw(t_us)


@breaks("scans_are_evenly_spaced", "within 500 us, saw 8000 us later")
class ScansJitter(Responder):
    def clock_us(self) -> int:
        return (super().clock_us() + 2_000 * (self.scans % 2)) % 2**32


@breaks("scans_are_evenly_spaced", "at most 0 scans left out.* saw [1-9]")
class LeavesScansOutUncounted(Responder):
    def scan(self) -> None:
        if self.scans % 50 == 0:
            self.scan_start_us += self.period_us()
        super().scan()


class QuaternionWords(Responder):
    """Puts `word` where the first node of each packet is."""

    kind: type = wire.Orient
    word = 0
    word_bytes = 6

    def send(self, packet: wire.Packet) -> None:
        if not isinstance(packet, self.kind):
            super().send(packet)
            return
        content = bytearray(wire.encode(packet))
        content[FIRST_NODE : FIRST_NODE + self.word_bytes] = self.word.to_bytes(self.word_bytes, "little")
        self.send_content(bytes(content))


def codes(*values: int, bits: int) -> int:
    """The bits of three components."""
    return sum(value << (2 + bits * index) for index, value in enumerate(values))


@breaks("orient_quaternions_are_unit", "squared length 1.5")
class ComponentsLongerThanOne(QuaternionWords):
    word = 1 << 47


@breaks("orient_quaternions_are_unit", "codes .32767")
class CodeThatIsNone(QuaternionWords):
    word = 1 << 47 | codes(32_767, 16_383, 16_383, bits=15)


@breaks("orient_quaternions_are_unit", "left out to be the largest")
class LargestComponentNotLeftOut(QuaternionWords):
    word = 1 << 47 | codes(32_000, 28_000, 16_383, bits=15)


@breaks("orient_quaternions_are_unit", "000000000005")
class InvalidNodeWithBits(QuaternionWords):
    word = 5


@breaks("compact_quaternions_are_unit", "squared length 1.5")
class CompactComponentsLongerThanOne(QuaternionWords):
    kind = wire.OrientCompact
    word_bytes = 4


@breaks("compact_quaternions_are_unit", "codes .1023")
class CompactCodeThatIsNone(QuaternionWords):
    kind = wire.OrientCompact
    word_bytes = 4
    word = codes(1_023, 511, 511, bits=10)


def fewer_rows(array: Any, count: int) -> Any:
    """The first rows of a structure of arrays."""
    return type(array)(**{name: values[:count] for name, values in vars(array).items()})


alters(
    "node_count_is_as_info_says",
    "saw 15",
    "orient",
    lambda packet, _: {"nodes": fewer_rows(packet.nodes, 15)},
)
alters(
    "node_count_is_as_info_says",
    "saw 1$",
    "compact",
    lambda packet, _: {"nodes": fewer_rows(packet.nodes, 1)},
)
alters("raw_counts_are_as_info_says", "16, 15", "raw", lambda raw, _: {"mags": fewer_rows(raw.mags, 15)})
alters(
    "raw_counts_are_in_range",
    "8192.* in slot 4",
    "raw",
    lambda raw, _: {"accels": altered_array(raw.accels, counts=put((2, 1), 8_192))},
)
alters(
    "raw_counts_are_in_range",
    "-131073.* in slot 7",
    "raw",
    lambda raw, _: {"mags": altered_array(raw.mags, counts=put((3, 0), -131_073))},
)
alters(
    "raw_reasons_are_legal",
    "99 in slot 0",
    "raw",
    lambda raw, _: {"accels": altered_array(raw.accels, reason=put(0, 99))},
)
alters(
    "slot_errors_count_unusable_readings",
    "from 0 to 0",
    "raw",
    lambda raw, _: {"mags": altered_array(raw.mags, reason=put(3, wire.SlotReason.STALE))},
)


alters("raw_ages_can_be", "saw 12000", "raw", lambda raw, _: {"accel_age_us": 12_000})
alters("raw_ages_can_be", "saw 15000", "raw", lambda raw, _: {"mag_age_us": 15_000})


@breaks("raw_reasons_are_legal", "ok in 5")
class AbsentSlotIsOkInRaw(Responder):
    absent_slots = (5,)

    def reasons(self) -> np.ndarray:
        return np.zeros(self.slot_count, np.uint8)


@breaks("rates_are_kept", "at 50 Hz in .* us, saw 4824[0-9][0-9] us")
class SlowAtFiftyHertz(Responder):
    def period_us(self) -> int:
        return super().period_us() + 100 * (self.rate_hz == 50)


@breaks("rates_are_kept", "at most 0 of [0-9]+ left out at 1 Hz, saw [1-9]")
class HalfAHertz(Responder):
    def period_us(self) -> int:
        return super().period_us() * (1 + (self.rate_hz == 1))


@breaks("modes_send_what_they_say", "mode 0: no Raw, saw [0-9]+")
class RawInEveryMode(Responder):
    def scan(self) -> None:
        super().scan()
        if Mode.RAW not in self.mode:
            self.send(self.raw(self.clock_us()))


@breaks("modes_send_what_they_say", "mode 6: OrientCompact, saw 0")
class NoCompactBesideRaw(Responder):
    def compact(self, t_us: int) -> Any:
        return super().raw(t_us) if Mode.RAW in self.mode else super().compact(t_us)


@breaks("mode_changes_keep_the_stream_whole", "saw no COBS")
class CutsAFrameWhenTheModeChanges(Responder):
    def set_mode(self, argument: int, data: bytes) -> Any:
        self.transmit(b"\x09\x02\x03\0")
        return super().set_mode(argument, data)


@breaks("mode_changes_keep_the_stream_whole", "sequence to go on, saw from [0-9]+ to 0")
class SequenceRestartsWithTheRate(Responder):
    def set_rate(self, argument: int, data: bytes) -> Any:
        answer = super().set_rate(argument, data)
        if answer[0] == AckCode.OK:
            self.sequence = 65_535
        return answer
