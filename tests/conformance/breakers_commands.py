"""Responders that break a rule of COMMAND and ACK, of set_phase, or of enter_dfu."""

from __future__ import annotations

from typing import Any

from conformance.responder import Responder
from conformance.rule_breakers import RuleBreakers
from ribbonhost import wire
from ribbonhost.wire import AckCode, Mode

BREAKERS = RuleBreakers()
breaks = BREAKERS.breaks

BAD: Any = (AckCode.BAD_ARGUMENT, 0, b"")


@breaks("ack_brings_tag_and_command_back", "tag 32768 .* none within")
class TagOfFifteenBits(Responder):
    def acknowledge(self, tag: int, *answer: Any) -> None:
        super().acknowledge(tag & 0x7FFF, *answer)


@breaks("ack_brings_tag_and_command_back", "the command back, saw 0")
class CommandNotEchoed(Responder):
    def acknowledge(self, tag: int, command: int, *answer: Any) -> None:
        super().acknowledge(tag, 0, *answer)


@breaks("ack_without_a_value_is_empty", "for identify 0, saw 0 and 2 bytes")
class AckWithData(Responder):
    def identify(self, argument: int, data: bytes) -> Any:
        return AckCode.OK, 0, b"hi"


@breaks("ack_without_a_value_is_empty", "for set_rate 0, saw 100 and 0 bytes")
class RefusesWithTheRateInUse(Responder):
    def set_rate(self, argument: int, data: bytes) -> Any:
        code, _, data = super().set_rate(argument, data)
        return code, self.rate_hz, data


@breaks("what_a_command_has_no_use_for_is_ignored", "get_status 4294967295, saw bad_argument")
class RefusesUnusedArguments(Responder):
    def get_status(self, argument: int, data: bytes) -> Any:
        return BAD if argument else super().get_status(argument, data)


@breaks("what_a_command_has_no_use_for_is_ignored", "ACK.value 1, .* saw 200")
class TakesTheRateFromTheData(Responder):
    def set_rate(self, argument: int, data: bytes) -> Any:
        return super().set_rate(int.from_bytes(data, "little") if data else argument, data)


@breaks("each_command_has_one_ack", "2 within")
class AcknowledgesTwice(Responder):
    def acknowledge(self, *answer: Any) -> None:
        super().acknowledge(*answer)
        super().acknowledge(*answer)


@breaks("repeated_command_is_acknowledged_again", "none within")
class IgnoresRepetitions(Responder):
    last_tag = -1

    def on_command(self, content: bytes) -> None:
        tag = int.from_bytes(content[1:3], "little")
        if tag != self.last_tag:
            super().on_command(content)
        self.last_tag = tag


@breaks("ack_comes_in_time", "after 0.3")
class SlowToAcknowledge(Responder):
    latency_us = 300_000


@breaks("ack_comes_in_time_under_load", "after 0.3")
class SlowUnderLoad(Responder):
    def acknowledge(self, *answer: Any) -> None:
        self.latency_us = 300_000 if self.mode == Mode.ORIENT | Mode.RAW else 1_000
        super().acknowledge(*answer)
        self.latency_us = 1_000


@breaks("unknown_commands_are_refused", "none within")
class IgnoresUnknownCommands(Responder):
    def on_command(self, content: bytes) -> None:
        if content[3] in self.commands:
            super().on_command(content)


@breaks("unknown_commands_are_refused", "saw bad_argument$")
class UnknownCommandIsABadArgument(Responder):
    def acknowledge(self, tag: int, command: int, code: AckCode, *answer: Any) -> None:
        known = command in self.commands
        super().acknowledge(tag, command, code if known else AckCode.BAD_ARGUMENT, *answer)


@breaks("short_command_is_refused", "bad_length, saw bad_argument$")
class PadsShortCommands(Responder):
    def on_command(self, content: bytes) -> None:
        super().on_command(content.ljust(13, b"\0"))


@breaks("short_command_is_refused", "no ACK")
class IgnoresShortCommands(Responder):
    def acknowledge(self, tag: int, command: int, code: AckCode, *answer: Any) -> None:
        if code != AckCode.BAD_LENGTH:
            super().acknowledge(tag, command, code, *answer)


@breaks("burst_is_answered_honestly", r"tags 4 to 53 in order, saw \[.*, 35\]")
class DropsWhatComesTooFast(Responder):
    """Holds 32 frames."""

    def receive(self, data: bytes) -> None:
        super().receive(b"".join(part + b"\0" for part in data.split(b"\0")[:-1][:32]))


@breaks("rate_one_is_taken", "saw bad_argument$")
class NoRateBelowTen(Responder):
    def set_rate(self, argument: int, data: bytes) -> Any:
        return BAD if argument < 10 else super().set_rate(argument, data)


@breaks("rate_one_is_taken", "ACK.value 1, .* saw 10$")
class RaisesLowRates(Responder):
    def set_rate(self, argument: int, data: bytes) -> Any:
        return super().set_rate(max(argument, 10), data) if argument else BAD


@breaks("rate_max_is_taken", "saw bad_argument$")
class RefusesTheLargestRate(Responder):
    def set_rate(self, argument: int, data: bytes) -> Any:
        return BAD if argument == self.rate_max_hz else super().set_rate(argument, data)


@breaks("rate_zero_is_refused", "saw ok$")
class RateZeroIsOne(Responder):
    def set_rate(self, argument: int, data: bytes) -> Any:
        return super().set_rate(argument or 1, data)


@breaks("rate_above_max_is_refused", "saw ok$")
class LimitsRates(Responder):
    def set_rate(self, argument: int, data: bytes) -> Any:
        return super().set_rate(min(argument, self.rate_max_hz), data)


@breaks("rate_above_limit_is_refused", "200 Hz still .* saw 100 Hz")
class SetsTheRateBeforeItIsChecked(Responder):
    def set_rate(self, argument: int, data: bytes) -> Any:
        answer = super().set_rate(argument, data)
        self.rate_hz = argument % 65_536 if argument == 65_636 else self.rate_hz
        return answer


@breaks("rate_above_limit_is_refused", "saw ok$")
class RateOfSixteenBits(Responder):
    def set_rate(self, argument: int, data: bytes) -> Any:
        return super().set_rate(argument % 65_536, data)


@breaks("legal_modes_are_taken", "saw bad_argument$")
class NoRawBesideCompact(Responder):
    def set_mode(self, argument: int, data: bytes) -> Any:
        return BAD if argument == 6 else super().set_mode(argument, data)


@breaks("legal_modes_are_taken", "ACK.value 1, the mode in use, saw 0")
class ModeNotTold(Responder):
    def set_mode(self, argument: int, data: bytes) -> Any:
        code, _, data = super().set_mode(argument, data)
        return code, 0, data


@breaks("illegal_modes_are_refused", "set_mode 256, saw ok$")
class ModeOfEightBits(Responder):
    def set_mode(self, argument: int, data: bytes) -> Any:
        return super().set_mode(argument & 0xFF, data)


@breaks("illegal_modes_are_refused", "set_mode 3, saw ok$")
class OrientWithCompact(Responder):
    def set_mode(self, argument: int, data: bytes) -> Any:
        return super().set_mode(1 if argument == 3 else argument, data)


@breaks("identify_limits_are_kept", "saw ok$")
class BlinksForEver(Responder):
    def identify(self, argument: int, data: bytes) -> Any:
        return AckCode.OK, 0, b""


@breaks("identify_limits_are_kept", "saw bad_argument$")
class BlinksForTenSeconds(Responder):
    def identify(self, argument: int, data: bytes) -> Any:
        return BAD if argument > 10_000 else super().identify(argument, data)


@breaks("enter_dfu_needs_its_key", "saw ok$")
class LeavesWithAnyKey(Responder):
    def enter_dfu(self, argument: int, data: bytes) -> Any:
        return super().enter_dfu(wire.ENTER_DFU_KEY, data)


@breaks("enter_dfu_needs_its_key", "none within")
class RefusesTheKeyButLeaves(Responder):
    def enter_dfu(self, argument: int, data: bytes) -> Any:
        self.after_ack.append(self.leave_firmware)
        return BAD


@breaks("enter_dfu_leaves_the_firmware", "silence after the ACK, saw [0-9]+ frames")
class StaysAfterDfu(Responder):
    def leave_firmware(self) -> None:
        pass


@breaks("enter_dfu_leaves_the_firmware", "saw storage_failed$")
class FailsToLeave(Responder):
    def enter_dfu(self, argument: int, data: bytes) -> Any:
        return (AckCode.STORAGE_FAILED, 0, b"") if argument == wire.ENTER_DFU_KEY else BAD


class PhaseBreaker(Responder):
    """Undoes or forges what set_phase does."""

    def set_phase(self, argument: int, data: bytes) -> Any:
        start_us = self.scan_start_us
        code, value, data = super().set_phase(argument, data)
        return self.forge(start_us, argument, code, value, data)

    def forge(self, start_us: int, argument: int, code: AckCode, value: int, data: bytes) -> Any:
        raise NotImplementedError


@breaks("scans_start_when_asked", "saw -3000 us beside")
class IgnoresThePhase(PhaseBreaker):
    def forge(self, start_us: int, argument: int, code: AckCode, value: int, data: bytes) -> Any:
        self.scan_start_us = start_us
        return code, value, data


@breaks("any_phase_is_taken", "saw bad_argument$")
class RefusesPhasesOfThePast(PhaseBreaker):
    def forge(self, start_us: int, argument: int, code: AckCode, value: int, data: bytes) -> Any:
        past = (argument - self.clock_us()) % 2**32 >= 2**31
        return BAD if past else (code, value, data)


@breaks("any_phase_is_taken", "saw -2500 us beside")
class IgnoresPhasesFarAhead(PhaseBreaker):
    def forge(self, start_us: int, argument: int, code: AckCode, value: int, data: bytes) -> Any:
        if 10_000_000 < (argument - self.clock_us()) % 2**32 < 2**31:
            self.scan_start_us = start_us
        return code, value, data


@breaks("phase_tells_the_move", "ACK.value 3000 us, .* saw 0 us")
class TellsNoMove(PhaseBreaker):
    def forge(self, start_us: int, argument: int, code: AckCode, value: int, data: bytes) -> Any:
        return code, 0, data


@breaks("phase_tells_the_move", "at most half of 10000 us, saw 6000 us")
class MovesForwardOnly(PhaseBreaker):
    def forge(self, start_us: int, argument: int, code: AckCode, value: int, data: bytes) -> Any:
        return code, value % 2**32 if value < 2**31 else (value + self.period_us()) % 2**32, data
