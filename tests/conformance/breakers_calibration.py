"""Responders that break a rule of the calibration record."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from conformance.responder import Responder
from conformance.rule_breakers import RuleBreakers
from ribbonhost import wire
from ribbonhost.framing import crc32
from ribbonhost.wire import AckCode

BREAKERS = RuleBreakers()
breaks, alters = BREAKERS.breaks, BREAKERS.alters

BAD: Any = (AckCode.BAD_ARGUMENT, 0, b"")


@breaks("record_is_read_in_chunks", "at most [0-9]+ bytes, the size told")
class SizeOfWhatIsLeft(Responder):
    def calibration_read(self, argument: int, data: bytes) -> Any:
        code, size, data = super().calibration_read(argument, data)
        return code, max(0, size - argument), data


@breaks("record_is_read_in_chunks", "of the record from 1, saw 192 bytes")
class ReadsWholeChunksOnly(Responder):
    def calibration_read(self, argument: int, data: bytes) -> Any:
        return super().calibration_read(
            argument // 192 * 192 if argument < len(self.record) else argument, data
        )


@breaks("reading_beyond_the_end_gives_nothing", "saw bad_argument$")
class RefusesToReadBeyondTheEnd(Responder):
    def calibration_read(self, argument: int, data: bytes) -> Any:
        return BAD if argument > len(self.record) else super().calibration_read(argument, data)


@breaks("reading_beyond_the_end_gives_nothing", "and 4")
class ReadsMemoryBehindTheRecord(Responder):
    def calibration_read(self, argument: int, data: bytes) -> Any:
        code, size, data = super().calibration_read(argument, data)
        return code, size, data if argument <= size else b"\xff" * 4


alters(
    "record_has_the_crc_of_info",
    "over 1556 bytes",
    "info",
    lambda info, _: {"calibration_crc32": info.calibration_crc32 ^ 1},
)


class UnsoundRecord(Responder):
    """Has a record in use that it should not have."""

    changes: dict[str, Any]

    def identity_record(self) -> bytes:
        record = wire.Calibration.unpack(super().identity_record())
        return dataclasses.replace(record, **self.changes).pack()


@breaks("record_is_sound", "layout 1, saw 7")
class LayoutUnknown(UnsoundRecord):
    changes = {"layout": 7}  # noqa: RUF012


@breaks("record_is_sound", "mag_axes in 2 to 3, saw 1")
class OneMagnetometerAxis(UnsoundRecord):
    changes = {"mag_axes": 1}  # noqa: RUF012


@breaks("record_is_sound", "field_horizontal_ut .* saw 0.0")
class NoField(UnsoundRecord):
    changes = {"field_horizontal_ut": 0.0}  # noqa: RUF012


@breaks("record_is_sound", "32 slots, as INFO says, saw 31")
class RecordOfOtherSlots(Responder):
    def identity_record(self) -> bytes:
        self.slot_count -= 1
        record = super().identity_record()
        self.slot_count += 1
        return record


@breaks("record_is_sound", "finite numbers")
class RecordWithANan(Responder):
    def identity_record(self) -> bytes:
        return super().identity_record()[:-4] + b"\x00\x00\xc0\x7f"


@breaks("uncalibrated_record_is_the_identity", "created_s 0, saw 1")
class MadeWhenNeverCalibrated(UnsoundRecord):
    changes = {"created_s": 1}  # noqa: RUF012


@breaks("uncalibrated_record_is_the_identity", "identity matrices")
class ZeroMatrices(Responder):
    def identity_record(self) -> bytes:
        return super().identity_record()[:20] + bytes(48 * self.slot_count)


@breaks("staging_changes_nothing_in_use", "INFO.calibration_crc32 .* saw [0-9a-f]{8}")
class WritesInPlace(Responder):
    def calibration_write(self, argument: int, data: bytes) -> Any:
        answer = super().calibration_write(argument, data)
        self.record = self.record[:argument] + data + self.record[argument + len(data) :]
        return answer


@breaks("staging_changes_nothing_in_use", "ACK.value 192, saw 0")
class TellsNoBytesWritten(Responder):
    def calibration_write(self, argument: int, data: bytes) -> Any:
        return super().calibration_write(argument, data)[0], 0, b""


@breaks("writing_nothing_is_refused", "saw ok$")
class WritesNothing(Responder):
    def calibration_write(self, argument: int, data: bytes) -> Any:
        return super().calibration_write(argument, data) if data else (AckCode.OK, 0, b"")


@breaks("writing_beyond_the_end_is_refused", "saw ok$")
class WritesWhatFits(Responder):
    def calibration_write(self, argument: int, data: bytes) -> Any:
        fits = data[: max(0, len(self.staged) - argument)]
        return super().calibration_write(argument, fits) if fits else BAD


@breaks("writing_beyond_the_end_is_refused", "saw bad_argument$")
class KeepsTheLastByteFree(Responder):
    def calibration_write(self, argument: int, data: bytes) -> Any:
        return BAD if argument + len(data) == len(self.staged) else super().calibration_write(argument, data)


@breaks("too_much_data_is_refused", "saw ok$")
class TakesTooMuchData(Responder):
    def on_command(self, content: bytes) -> None:
        super().on_command(content[:8] + bytes([min(content[8], 192)]) + content[9:])


class CommitBreaker(Responder):
    """Passes over one of the tests that a commit has to make."""

    def has_layout(self, record: bytes) -> bool:
        return self.passes_over == "layout" or super().has_layout(record)

    def has_own_slots(self, record: bytes) -> bool:
        return self.passes_over == "slots" or super().has_own_slots(record)

    def is_finite(self, record: bytes) -> bool:
        return self.passes_over == "finite" or super().is_finite(record)

    def is_in_range(self, record: bytes) -> bool:
        return self.passes_over == "range" or super().is_in_range(record)

    passes_over = ""


@breaks("commit_with_wrong_crc_is_refused", "saw ok$")
class CommitsAnyCrc(Responder):
    def calibration_commit(self, argument: int, data: bytes) -> Any:
        return super().calibration_commit(crc32(bytes(self.staged)), data)


@breaks("commit_with_wrong_crc_is_refused", "INFO.calibration_crc32 .* saw [0-9a-f]{8}")
class UsesWhatItRefuses(Responder):
    def calibration_commit(self, argument: int, data: bytes) -> Any:
        answer = super().calibration_commit(argument, data)
        self.record = bytes(self.staged)
        return answer


@breaks("commit_of_wrong_layout_is_refused", "saw ok$")
class CommitsAnyLayout(CommitBreaker):
    passes_over = "layout"


@breaks("commit_of_wrong_slot_count_is_refused", "saw ok$")
class CommitsAnySlotCount(CommitBreaker):
    passes_over = "slots"


@breaks("commit_of_numbers_that_are_none_is_refused", "saw ok$")
class CommitsNans(CommitBreaker):
    passes_over = "finite"


@breaks("commit_of_values_out_of_range_is_refused", "saw ok$")
class CommitsAnyRange(CommitBreaker):
    passes_over = "range"


@breaks("commit_puts_a_record_in_use", "ACK.value 1, saw 0")
class SequenceNotCounted(Responder):
    def calibration_commit(self, argument: int, data: bytes) -> Any:
        code, _, data = super().calibration_commit(argument, data)
        self.calibration_sequence = 0
        return code, 0, data


@breaks("commit_puts_a_record_in_use", "INFO.calibration_crc32 .* saw [0-9a-f]{8}")
class CommitsNothing(Responder):
    def calibration_commit(self, argument: int, data: bytes) -> Any:
        record = self.record
        answer = super().calibration_commit(argument, data)
        self.record = record
        return answer


@breaks("commit_puts_a_record_in_use", "saw bad_crc")
class StagesInOrderOnly(Responder):
    def calibration_write(self, argument: int, data: bytes) -> Any:
        if argument == 0:
            self.staged = bytearray(len(self.record))
        return super().calibration_write(argument, data)


@breaks("commit_of_the_record_in_use_changes_nothing", "ACK.value 0, the sequence in use, saw 1")
class CountsEveryCommit(Responder):
    def calibration_commit(self, argument: int, data: bytes) -> Any:
        code, _, data = super().calibration_commit(argument, data)
        self.calibration_sequence += code == AckCode.OK
        return code, self.calibration_sequence, data


@breaks("info_follows_the_record", "pitch_m 0.0125 of the record in use, saw 0.025")
class PitchOfItsOwn(Responder):
    def info(self) -> wire.Info:
        return dataclasses.replace(super().info(), pitch_m=0.025)


@breaks("info_follows_the_record", "axes 7 of the record in use in slot 1, saw 3")
class AlwaysTwoAxes(Responder):
    def info(self) -> wire.Info:
        info = super().info()
        axes = np.tile([7, 3], self.slot_count // 2).astype(np.uint8)
        return dataclasses.replace(info, slots=dataclasses.replace(info.slots, axes=axes))
