"""Frames in both directions: what the device sends decodes, what it cannot use it counts and survives."""

from __future__ import annotations

import random

from ribbonhost.framing import CRC_BYTES, MAX_COBS_BYTES, crc16, encode_frame
from ribbonhost.wire import (
    MAX_PACKET_BYTES,
    SCHEMA_HASH,
    Ack,
    AckCode,
    ClockPing,
    ClockPong,
    CommandCode,
    Mode,
    PacketId,
    encode,
)

from ribbonhil.conformance.check import BrokenRuleError, Group, expect
from ribbonhil.conformance.checks.recordings import both
from ribbonhil.conformance.client import PATIENCE_S, code_name, command_packet, inspect
from ribbonhil.conformance.device import Device

GROUP = Group("framing")

UNKNOWN_PACKET_ID = 0x7E
FROM_HOST = (PacketId.COMMAND, PacketId.CLOCK_PING)
RX_COUNTERS = ("rx_crc_errors", "rx_malformed", "rx_unknown")


def damaged(frame: bytes) -> bytes:
    """The frame with one bit changed such that it is still COBS and only the CRC tells."""
    for index in range(len(frame) - 2, 0, -1):
        for bit in range(8):
            coded = bytearray(frame[:-1])
            coded[index] ^= 1 << bit
            if coded[index] and inspect(bytes(coded), 0.0).problem == "wrong CRC":
                return bytes(coded) + b"\0"
    raise ValueError("no bit of this frame is covered by its CRC alone")


def counted(device: Device, sent: bytes) -> dict[str, int]:
    """By how much each rx counter of STATUS rises when `sent` is."""
    _, before = device.get_status()
    device.send_bytes(sent)
    _, after = device.get_status()
    return {name: (getattr(after, name) - getattr(before, name)) % 2**32 for name in RX_COUNTERS}


def only(name: str) -> dict[str, int]:
    """One more in this counter, none in the others."""
    return {counter: int(counter == name) for counter in RX_COUNTERS}


def expect_answered(device: Device, packet: bytes, tag: int, what: str) -> None:
    """Raises BrokenRuleError unless the packet, a COMMAND with that tag, is acknowledged as done."""
    reply = device.try_packet(packet, tag)
    if reply is None:
        raise BrokenRuleError(f"an ACK for {what}", "none", encode_frame(packet))
    expect(reply.ack.code == AckCode.OK, f"ok for {what}", code_name(reply.ack.code), reply.frame)


def expect_alive(device: Device, after: str) -> None:
    """Raises BrokenRuleError unless a command is acknowledged."""
    tag = device.next_tag()
    expect_answered(device, command_packet(CommandCode.GET_STATUS, tag=tag), tag, f"a command after {after}")


@GROUP.check("Framing")
def frames_are_cobs_with_crc(device: Device) -> None:
    """Every frame the device sends is COBS with a right CRC-16 and ends in one 0x00."""
    recording = both(device)
    expect(len(recording.frames) > 0, "frames", "none")
    for frame in device.log:
        expect(bool(frame.content), "COBS with a right CRC", frame.problem, frame)


@GROUP.check("Framing")
def frames_are_short_enough(device: Device) -> None:
    """No frame is longer than that of a packet of max_packet_bytes."""
    both(device)
    for frame in device.log:
        size = len(frame.coded)
        expect(size <= MAX_COBS_BYTES, f"at most {MAX_COBS_BYTES} bytes", f"{size} bytes", frame)


@GROUP.check("Compatibility")
def packets_decode(device: Device) -> None:
    """Every packet has all fields of its type; under the same schema no other types and no surplus bytes."""
    both(device)
    same_schema = device.info.schema_hash == SCHEMA_HASH
    for frame in device.log:
        if frame.content and (same_schema or frame.is_known):
            expect(frame.packet is not None, "a packet that decodes", frame.problem, frame)
            expect(not same_schema or frame.surplus == 0, "no surplus", f"{frame.surplus} bytes", frame)


@GROUP.check("Framing")
def doubled_delimiters_are_harmless(device: Device) -> None:
    """Delimiters between frames, however many, are no frames and change no counter."""
    sent = (
        b"\0\0\0\0"
        + encode_frame(command_packet(CommandCode.GET_STATUS, tag=device.next_tag()))
        + b"\0\0\0\0"
    )
    rise = counted(device, sent)
    expect(rise == dict.fromkeys(RX_COUNTERS, 0), "no counter to rise", rise)


@GROUP.check("Framing")
def frame_in_pieces_is_taken(device: Device) -> None:
    """A frame may arrive byte by byte."""
    tag = device.next_tag()
    since = device.mark()
    for byte in encode_frame(command_packet(CommandCode.GET_STATUS, tag=tag)):
        device.send_bytes(bytes([byte]))
        device.receive(0.002)
    answer = device.wait_for(lambda f: isinstance(f.packet, Ack) and f.packet.tag == tag, since, 1.0)
    expect(answer is not None, "an ACK for a command sent byte by byte", "none")


@GROUP.check("Framing")
def frames_in_one_piece_are_all_taken(device: Device) -> None:
    """Frames that arrive together are all answered, in their order."""
    tags = [device.next_tag() for _ in range(3)]
    since = device.mark()
    device.send_bytes(b"".join(encode_frame(command_packet(CommandCode.GET_STATUS, tag=tag)) for tag in tags))
    device.wait_for(lambda f: isinstance(f.packet, Ack) and f.packet.tag == tags[-1], since, 1.0)
    seen = [f.packet.tag for f in device.log[since:] if isinstance(f.packet, Ack)]
    expect(seen == tags, f"ACKs with tags {tags}", seen)


@GROUP.check("Framing")
def garbage_is_survived(device: Device) -> None:
    """After any bytes and a delimiter the next frame is taken."""
    noise = random.Random(20).randbytes(300)
    device.send_bytes(noise + b"\0")
    expect_alive(device, "300 random bytes and a delimiter")


@GROUP.check("Framing")
def garbage_loses_one_frame_only(device: Device) -> None:
    """Bytes that run into a frame cost that frame; the one after it is taken."""
    lost, taken = device.next_tag(), device.next_tag()
    since = device.mark()
    device.send_bytes(b"\x55\xaa\x11" + encode_frame(command_packet(CommandCode.GET_STATUS, tag=lost)))
    expect_answered(
        device, command_packet(CommandCode.GET_STATUS, tag=taken), taken, "the frame after a spoiled one"
    )
    for frame in device.log[since:]:
        acted = isinstance(frame.packet, Ack) and frame.packet.tag == lost
        expect(not acted, "no ACK for the spoiled frame", "one", frame)


@GROUP.check("Framing")
def bad_crc_is_not_acted_on(device: Device) -> None:
    """A frame with a wrong CRC is neither acted on nor answered."""
    rate_hz = 7 if device.info.rate_max_hz >= 7 else 1
    device.set(device.info.rate_max_hz, Mode(0))
    tag = device.next_tag()
    sent = damaged(encode_frame(command_packet(CommandCode.SET_RATE, rate_hz, tag=tag)))
    since = device.mark()
    device.send_bytes(sent)
    _, status = device.get_status()
    device.receive(0.05)
    for frame in device.log[since:]:
        own = isinstance(frame.packet, Ack) and frame.packet.command == CommandCode.SET_RATE
        expect(not own, "no ACK for a frame with a wrong CRC", "one", frame)
    if status.rate_hz != device.info.rate_max_hz:
        raise BrokenRuleError(
            "the rate not to change by a frame with a wrong CRC", f"{status.rate_hz} Hz", sent
        )


@GROUP.check("Framing")
def bad_crc_is_counted(device: Device) -> None:
    """A frame with a wrong CRC raises rx_crc_errors by one."""
    sent = damaged(encode_frame(command_packet(CommandCode.GET_STATUS, tag=device.next_tag())))
    rise = counted(device, sent)
    if rise != only("rx_crc_errors"):
        raise BrokenRuleError("rx_crc_errors to rise by one, nothing else", str(rise), sent)


@GROUP.check("Framing")
def malformed_is_counted(device: Device) -> None:
    """A frame that is no COBS, or too short for a packet and its CRC, raises rx_malformed by one."""
    for sent in (b"\x05\x11\x22\0", b"\x01\0", b"\x03\x41\x42\0"):
        rise = counted(device, sent)
        if rise != only("rx_malformed"):
            raise BrokenRuleError("rx_malformed to rise by one, nothing else", str(rise), sent)


@GROUP.check("Framing")
def cut_frame_is_counted(device: Device) -> None:
    """A frame that was cut short raises rx_malformed or rx_crc_errors by one, and is not acted on."""
    tag = device.next_tag()
    whole = encode_frame(command_packet(CommandCode.SET_RATE, 0x01010101, b"\x11\x22\x33\x44", tag))
    sent = whole[: len(whole) // 2] + b"\0"
    since = device.mark()
    rise = counted(device, sent)
    if (rise["rx_malformed"] + rise["rx_crc_errors"], rise["rx_unknown"]) != (1, 0):
        raise BrokenRuleError("rx_malformed or rx_crc_errors to rise by one", str(rise), sent)
    for frame in device.log[since:]:
        expect(not (isinstance(frame.packet, Ack) and frame.packet.tag == tag), "no ACK", "one", frame)


@GROUP.check("Framing")
def too_long_frame_is_survived(device: Device) -> None:
    """A frame longer than any packet is counted once as malformed, and the next one is taken."""
    sent = b"\x55" * (2 * MAX_PACKET_BYTES) + b"\0"
    rise = counted(device, sent)
    expect(rise == only("rx_malformed"), "rx_malformed to rise by one, nothing else", rise)
    expect_alive(device, f"a frame of {len(sent)} bytes")


@GROUP.check("Framing")
def longest_packet_is_read(device: Device) -> None:
    """A packet of max_packet_bytes is read, counted as unknown if it is; one byte more is malformed."""
    for size, counter in ((MAX_PACKET_BYTES, "rx_unknown"), (MAX_PACKET_BYTES + 1, "rx_malformed")):
        sent = frame_without_zeros(size)
        rise = counted(device, sent)
        if rise != only(counter):
            raise BrokenRuleError(f"{counter} to rise by one for a packet of {size} bytes", rise, sent)


def frame_without_zeros(size: int) -> bytes:
    """A frame of an unknown packet of `size` bytes, of which none is zero, however long it is."""
    for filler in range(1, 256):
        content = bytes([UNKNOWN_PACKET_ID]) + bytes([filler]) * (size - 1)
        content += crc16(content).to_bytes(CRC_BYTES, "little")
        if 0 not in content:
            break
    frame = b""
    for at in range(0, len(content), 254):
        block = content[at : at + 254]
        frame += bytes([len(block) + 1]) + block
    return frame + b"\0"


@GROUP.check("Framing")
def both_forms_of_a_full_block_are_read(device: Device) -> None:
    """COBS of a content that ends in a full block is read with and without an empty block after it."""
    command = command_packet(CommandCode.GET_STATUS, tag=0x0101)
    # The last zero of a COMMAND without data is its data_count: what is appended makes the full block.
    for filler in range(1, 256):
        packet = command + bytes([filler]) * (254 - CRC_BYTES)
        if 0 not in crc16(packet).to_bytes(CRC_BYTES, "little"):
            break
    frame = encode_frame(packet)
    short = frame.removesuffix(b"\x01\0").removesuffix(b"\0")
    for sent in (short + b"\0", short + b"\x01\0"):
        since = device.mark()
        device.send_bytes(sent)
        ack = device.wait_for(
            lambda f: isinstance(f.packet, Ack) and f.packet.tag == 0x0101, since, PATIENCE_S
        )
        if ack is None:
            raise BrokenRuleError("an ACK for a COMMAND whose content ends in a full block", "none", sent)


@GROUP.check("STATUS")
def unknown_packet_is_counted(device: Device) -> None:
    """A packet of a type the device does not know, or only sends, raises rx_unknown and has no answer."""
    since = device.mark()
    types = (UNKNOWN_PACKET_ID, 0, 0xFF, *(kind for kind in PacketId if kind not in FROM_HOST))
    for packet_type in types:
        sent = encode_frame(bytes([packet_type]) + b"\x01\x02\x03")
        rise = counted(device, sent)
        if rise != only("rx_unknown"):
            raise BrokenRuleError(f"rx_unknown to rise by one for type {packet_type}", rise, sent)
    acks = [f for f in device.log[since:] if isinstance(f.packet, Ack)]
    expect(len(acks) == 2 * len(types), "ACKs only for the get_status", f"{len(acks)} ACKs", *acks[-1:])


@GROUP.check("STATUS")
def packet_without_a_tag_is_malformed(device: Device) -> None:
    """A CLOCK_PING that ends before its fields, or a COMMAND before its command, raises rx_malformed."""
    ping = encode(ClockPing(tag=1, t_host_us=1))
    command = command_packet(CommandCode.GET_STATUS, tag=1)
    for packet in (ping[:-1], ping[:3], ping[:1], command[:3], command[:1]):
        sent = encode_frame(packet)
        rise = counted(device, sent)
        if rise != only("rx_malformed"):
            raise BrokenRuleError("rx_malformed to rise by one, nothing else", rise, sent)


@GROUP.check("Compatibility")
def appended_command_fields_are_ignored(device: Device) -> None:
    """Bytes after the last known field of a COMMAND are ignored: a later host may append some."""
    tag = device.next_tag()
    packet = command_packet(CommandCode.GET_STATUS, tag=tag) + b"\x01\x02\x03\x04"
    expect_answered(device, packet, tag, "a COMMAND with 4 appended bytes")


@GROUP.check("Compatibility")
def appended_ping_fields_are_ignored(device: Device) -> None:
    """Bytes after the last known field of a CLOCK_PING are ignored."""
    tag = device.next_tag()
    since = device.mark()
    device.send(encode(ClockPing(tag=tag, t_host_us=1)) + b"\x01\x02\x03\x04")
    pong = device.wait_for(lambda f: isinstance(f.packet, ClockPong) and f.packet.tag == tag, since, 1.0)
    expect(pong is not None, "a CLOCK_PONG for a CLOCK_PING with 4 appended bytes", "none")
