"""Responders that break a rule of frames."""

from __future__ import annotations

from typing import Any

from conformance.responder import Responder
from conformance.rule_breakers import RuleBreakers
from ribbonhost import wire
from ribbonhost.framing import Deframer, encode_frame

BREAKERS = RuleBreakers()
breaks = BREAKERS.breaks


@breaks("frames_are_cobs_with_crc", "wrong CRC")
class CrcOfZeroNowAndThen(Responder):
    sent = 0

    def send_content(self, content: bytes) -> None:
        self.sent += 1
        frame = encode_frame(content)
        if self.sent % 100 == 0:
            frame = frame[:-3] + bytes(((frame[-3] + 1) % 255 + 1, frame[-2])) + b"\0"
        self.transmit(frame)


@breaks("frames_are_short_enough", "saw 700 bytes")
class PacketTooLong(Responder):
    def status(self) -> wire.Status:
        self.transmit(b"\x44" * 700 + b"\0")
        return super().status()


@breaks("packets_decode", "saw Orient ends after")
class OrientWithoutItsLastByte(Responder):
    def orient(self, t_us: int) -> Any:
        self.send_content(wire.encode(super().orient(t_us))[:-1])
        return super().orient(t_us)


@breaks("packets_decode", "no surplus, saw 2 bytes")
class SurplusBytesInTheSameSchema(Responder):
    def send(self, packet: wire.Packet) -> None:
        self.send_content(wire.encode(packet) + b"\0\0")


@breaks("packets_decode", "saw A packet of type 0x7f")
class UnknownTypeInTheSameSchema(Responder):
    def status(self) -> wire.Status:
        self.send_content(b"\x7f\x01")
        return super().status()


@breaks("doubled_delimiters_are_harmless", "'rx_malformed': [1-9]")
class EmptyFramesAreMalformed(Responder):
    def on_frame(self, coded: bytes) -> None:
        self.rx["rx_malformed"] += not coded
        super().on_frame(coded)


@breaks("frame_in_pieces_is_taken", "byte by byte, saw none")
class ForgetsPartsOfFrames(Responder):
    def receive(self, data: bytes) -> None:
        self.inbox = b""
        super().receive(data)


@breaks("frames_in_one_piece_are_all_taken", r"saw \[\d+\]")
class TakesTheFirstFrameOnly(Responder):
    def receive(self, data: bytes) -> None:
        super().receive(data[: data.find(b"\0") + 1] or data)


class DeafAfterABadFrame(Responder):
    """Swallows the frame after one that it could not use."""

    deaf = False

    def on_frame(self, coded: bytes) -> None:
        if self.deaf:
            self.deaf = False
            return
        bad = sum(self.rx.values())
        super().on_frame(coded)
        self.deaf = sum(self.rx.values()) > bad


@breaks("garbage_is_survived", "after 300 random bytes and a delimiter, saw none")
class DiesOfGarbage(Responder):
    def on_frame(self, coded: bytes) -> None:
        bad = sum(self.rx.values())
        super().on_frame(coded)
        if sum(self.rx.values()) > bad:
            self.leave_firmware()


@breaks("garbage_loses_one_frame_only", "the frame after a spoiled one, saw none")
class GarbageLosesTwoFrames(DeafAfterABadFrame):
    pass


@breaks("garbage_loses_one_frame_only", "no ACK for the spoiled frame, saw one")
class FindsFramesInsideFrames(Responder):
    def on_frame(self, coded: bytes) -> None:
        for start in range(len(coded)):
            if Deframer().feed(coded[start:] + b"\0"):
                super().on_frame(coded[start:])
                return
        super().on_frame(coded)


def content_whatever_its_crc(coded: bytes) -> bytes:
    """The content of a frame that is COBS, with the CRC taken off unread."""
    content = b""
    while coded:
        content += coded[1 : coded[0]] + (b"\0" if coded[0] < 0xFF else b"")
        coded = coded[coded[0] :]
    return content[:-3]


@breaks("bad_crc_is_not_acted_on", "no ACK for a frame with a wrong CRC, saw one")
class IgnoresTheCrc(Responder):
    def on_frame(self, coded: bytes) -> None:
        content = content_whatever_its_crc(coded)
        if content:
            self.on_frame_checked(content)

    def on_frame_checked(self, content: bytes) -> None:
        super().on_frame(encode_frame(content)[:-1])


@breaks("bad_crc_is_not_acted_on", "the rate not to change.* saw 7 Hz")
class ActsOnABadCrcInSilence(IgnoresTheCrc):
    def acknowledge(self, tag: int, command: int, *answer: Any) -> None:
        if command != wire.CommandCode.SET_RATE or answer[1] != 7:
            super().acknowledge(tag, command, *answer)


@breaks("bad_crc_is_counted", "'rx_crc_errors': 0")
class CrcErrorsNotCounted(Responder):
    def status(self) -> wire.Status:
        self.rx["rx_crc_errors"] = 0
        return super().status()


@breaks("malformed_is_counted", "'rx_malformed': 0")
class MalformedCountedAsCrcErrors(Responder):
    def status(self) -> wire.Status:
        self.rx["rx_crc_errors"] += self.rx["rx_malformed"]
        self.rx["rx_malformed"] = 0
        return super().status()


@breaks("cut_frame_is_counted", "'rx_malformed': 0")
class CutFramesNotCounted(Responder):
    def on_frame(self, coded: bytes) -> None:
        if not 5 < len(coded) < 11:
            super().on_frame(coded)


@breaks("too_long_frame_is_survived", "'rx_malformed': [2-9]")
class LongFrameCountedInPieces(Responder):
    def on_frame(self, coded: bytes) -> None:
        while coded:
            super().on_frame(coded[:256])
            coded = coded[256:]


@breaks("too_long_frame_is_survived", "an ACK .* saw none")
class DiesOfALongFrame(Responder):
    def on_frame(self, coded: bytes) -> None:
        if len(coded) > 700:
            self.leave_firmware()
        super().on_frame(coded)


@breaks("unknown_packet_is_counted", "'rx_unknown': 0")
class UnknownNotCounted(Responder):
    def status(self) -> wire.Status:
        self.rx["rx_unknown"] = 0
        return super().status()


@breaks("unknown_packet_is_counted", "[0-9]+ ACKs")
class UnknownAcknowledged(Responder):
    def on_packet(self, content: bytes) -> None:
        if content[0] == 0x7E:
            self.acknowledge(0, 0, wire.AckCode.UNKNOWN_COMMAND, 0, b"")
        super().on_packet(content)


@breaks("unknown_packet_is_counted", "for type 17, saw .*'rx_unknown': 0")
class PacketsOfDevicesNotCounted(Responder):
    def on_packet(self, content: bytes) -> None:
        if content[0] != wire.PacketId.ACK:
            super().on_packet(content)


@breaks("packet_without_a_tag_is_malformed", "'rx_malformed': 0")
class ShortPingsNotCounted(Responder):
    def on_ping(self, content: bytes) -> None:
        if len(content) >= 11:
            super().on_ping(content)


@breaks("packet_without_a_tag_is_malformed", "'rx_malformed': 0")
class ShortCommandsNotCounted(Responder):
    def on_command(self, content: bytes) -> None:
        if len(content) >= 4:
            super().on_command(content)


@breaks("longest_packet_is_read", "for a packet of 576 bytes")
class HoldsFiveHundredBytes(Responder):
    def on_frame(self, coded: bytes) -> None:
        super().on_frame(coded if len(coded) <= 515 else b"\x05\x01")


@breaks("longest_packet_is_read", "for a packet of 577 bytes, saw .*'rx_malformed': 0")
class ReadsPacketsThatAreTooLong(Responder):
    def on_frame(self, coded: bytes) -> None:
        super().on_frame(coded if len(coded) <= 581 else encode_frame(b"\x7e")[:-1])


@breaks("both_forms_of_a_full_block_are_read", "ends in a full block, saw none")
class WantsABlockAfterAFullOne(Responder):
    def on_frame(self, coded: bytes) -> None:
        if len(coded) < 254 or coded.endswith(b"\x01"):
            super().on_frame(coded)


@breaks("both_forms_of_a_full_block_are_read", "ends in a full block, saw none")
class WantsNoBlockAfterAFullOne(Responder):
    def on_frame(self, coded: bytes) -> None:
        if len(coded) < 254 or not coded.endswith(b"\x01"):
            super().on_frame(coded)


@breaks("appended_command_fields_are_ignored", "saw bad_length$")
class AppendedCommandFieldsRefused(Responder):
    def on_command(self, content: bytes) -> None:
        count = content[8]
        if len(content) == 9 + count:
            super().on_command(content)
        else:
            super().on_command(content[:8] + bytes([200]) + content[9:])


@breaks("appended_ping_fields_are_ignored", "CLOCK_PONG .* saw none")
class AppendedPingFieldsRefused(Responder):
    def on_ping(self, content: bytes) -> None:
        if len(content) == 11:
            super().on_ping(content)
