"""COMMAND and ACK: every command, its limits, and the ways in which it can end."""

from __future__ import annotations

from ribbonhost.framing import encode_frame
from ribbonhost.wire import (
    ENTER_DFU_KEY,
    IDENTIFY_MAX_MS,
    Ack,
    AckCode,
    CommandCode,
    Mode,
)

from ribbonhil.conformance.check import BrokenRuleError, Group, expect
from ribbonhil.conformance.client import ACK_LIMIT_S, PATIENCE_S, code_name, command_name, command_packet
from ribbonhil.conformance.device import Device

GROUP = Group("command")

RATE_LIMIT_HZ = 200
UNKNOWN_COMMANDS = (0, 11, 127, 255)
LEGAL_MODES = (0, 1, 2, 4, 5, 6)
ILLEGAL_MODES = (3, 7, 8, 0x80, 0x100, 0x101, 0x80000001, 0xFFFFFFFF)
BURST = 50


def rate_in_use(device: Device) -> int:
    _, status = device.get_status()
    return int(status.rate_hz)


def expect_rate_refused(device: Device, rate_hz: int) -> None:
    """Raises BrokenRuleError unless this rate is a bad_argument and the rate in use stays."""
    keep_hz = device.info.rate_max_hz
    device.accepted(CommandCode.SET_RATE, keep_hz)
    device.answered(AckCode.BAD_ARGUMENT, CommandCode.SET_RATE, rate_hz)
    seen_hz = rate_in_use(device)
    expect(seen_hz == keep_hz, f"{keep_hz} Hz still after {rate_hz} was refused", f"{seen_hz} Hz")


def expect_rate_taken(device: Device, rate_hz: int) -> None:
    """Raises BrokenRuleError unless this rate is accepted, told in ACK.value, and in use."""
    reply = device.accepted(CommandCode.SET_RATE, rate_hz)
    expect(reply.ack.value == rate_hz, f"ACK.value {rate_hz}, the rate in use", reply.ack.value, reply.frame)
    seen_hz = rate_in_use(device)
    expect(seen_hz == rate_hz, f"{rate_hz} Hz in use", f"{seen_hz} Hz")


@GROUP.check("COMMAND")
def ack_brings_tag_and_command_back(device: Device) -> None:
    """An ACK has tag and command of its COMMAND, for every tag."""
    for tag in (0, 1, 0x00FF, 0x0100, 0x8000, 65535):
        reply = device.command(CommandCode.GET_STATUS, tag=tag)
        expect(
            reply.ack.command == CommandCode.GET_STATUS, "the command back", reply.ack.command, reply.frame
        )
        expect(reply.ack.code == AckCode.OK, "ok", code_name(reply.ack.code), reply.frame)


@GROUP.check("COMMAND")
def ack_without_a_value_is_empty(device: Device) -> None:
    """ACK.value is 0 and its data empty where the command says nothing else, and where it is refused."""
    for command, argument in (
        (CommandCode.GET_INFO, 0),
        (CommandCode.GET_STATUS, 0),
        (CommandCode.IDENTIFY, 0),
        (CommandCode.SET_RATE, 0),
        (CommandCode.SET_MODE, 3),
        (CommandCode.CALIBRATION_WRITE, 0),
        (UNKNOWN_COMMANDS[-1], 1),
    ):
        reply = device.command(command, argument)
        expect(
            (reply.ack.value, reply.ack.data) == (0, b""),
            f"value 0 and no data for {command_name(command, argument)}",
            f"{reply.ack.value} and {len(reply.ack.data)} bytes",
            reply.frame,
        )


@GROUP.check("COMMAND")
def what_a_command_has_no_use_for_is_ignored(device: Device) -> None:
    """An argument or data that a command has no use for change nothing."""
    device.accepted(CommandCode.GET_STATUS, 0xFFFFFFFF)
    device.accepted(CommandCode.GET_INFO, 1, bytes(range(192)))
    reply = device.accepted(CommandCode.SET_RATE, 1, b"\xc8\x00\x00\x00")
    expect(reply.ack.value == 1, "ACK.value 1, the rate in use", reply.ack.value, reply.frame)


@GROUP.check("COMMAND")
def each_command_has_one_ack(device: Device) -> None:
    """A command is acknowledged once."""
    since = device.mark()
    reply = device.accepted(CommandCode.GET_STATUS)
    device.receive(2 * ACK_LIMIT_S)
    acks = [f for f in device.log[since:] if isinstance(f.packet, Ack) and f.packet.tag == reply.ack.tag]
    expect(len(acks) == 1, "one ACK", f"{len(acks)} within {2 * ACK_LIMIT_S:g} s", *acks)


@GROUP.check("COMMAND")
def repeated_command_is_acknowledged_again(device: Device) -> None:
    """A command that a host repeats with the same tag is done and acknowledged again."""
    tag = device.next_tag()
    for _ in range(2):
        reply = device.command(CommandCode.SET_RATE, device.info.rate_max_hz, tag=tag)
        seen = (reply.ack.code, reply.ack.value)
        wanted = (AckCode.OK, device.info.rate_max_hz)
        expect(
            seen == wanted,
            f"ok with value {wanted[1]} both times",
            f"code {seen[0]}, value {seen[1]}",
            reply.frame,
        )


@GROUP.check("COMMAND")
def ack_comes_in_time(device: Device) -> None:
    """A command is acknowledged within 0.25 s."""
    for _ in range(10):
        expect_in_time(device, "")


@GROUP.check("COMMAND")
def ack_comes_in_time_under_load(device: Device) -> None:
    """A command is acknowledged within 0.25 s at the largest rate with ORIENT and RAW."""
    device.set(device.info.rate_max_hz, Mode.ORIENT | Mode.RAW)
    for _ in range(10):
        device.receive(0.05)
        expect_in_time(device, " under load")


def expect_in_time(device: Device, when: str) -> None:
    """Raises BrokenRuleError unless an ACK comes within 0.25 s."""
    reply = device.command(CommandCode.GET_STATUS)
    took_s = reply.round_trip_s
    expect(
        took_s <= ACK_LIMIT_S, f"an ACK within {ACK_LIMIT_S:g} s{when}", f"after {took_s:.3f} s", reply.frame
    )


@GROUP.check("COMMAND")
def unknown_commands_are_refused(device: Device) -> None:
    """A command code that the device does not know is acknowledged as unknown_command."""
    for command in UNKNOWN_COMMANDS:
        reply = device.answered(AckCode.UNKNOWN_COMMAND, command)
        expect(reply.ack.command == command, f"command {command} back", reply.ack.command, reply.frame)


@GROUP.check("COMMAND")
def short_command_is_refused(device: Device) -> None:
    """A COMMAND that ends before its fields do is bad_length, if tag and command are there."""
    device.accepted(CommandCode.SET_RATE, device.info.rate_max_hz)
    for size in (4, 7, 8, 9, 12):
        tag = device.next_tag()
        packet = command_packet(CommandCode.SET_RATE, 1, b"\x01\x02\x03\x04", tag)[:size]
        reply = device.try_packet(packet, tag)
        if reply is None:
            raise BrokenRuleError(
                f"bad_length for the first {size} bytes of a COMMAND", "no ACK", encode_frame(packet)
            )
        expect(reply.ack.code == AckCode.BAD_LENGTH, "bad_length", code_name(reply.ack.code), reply.frame)
    seen_hz = rate_in_use(device)
    expect(seen_hz == device.info.rate_max_hz, f"{device.info.rate_max_hz} Hz still", f"{seen_hz} Hz")


@GROUP.check("COMMAND")
def burst_is_answered_honestly(device: Device) -> None:
    """Of 50 commands sent together each is acknowledged once, in order, none is lost or done twice."""
    tags = [device.next_tag() for _ in range(BURST)]
    since = device.mark()
    device.send_bytes(b"".join(encode_frame(command_packet(CommandCode.IDENTIFY, tag=tag)) for tag in tags))
    device.wait_for(lambda f: isinstance(f.packet, Ack) and f.packet.tag == tags[-1], since, PATIENCE_S)
    device.receive(0.1)
    seen = [f.packet.tag for f in device.log[since:] if isinstance(f.packet, Ack)]
    expect(seen == tags, f"ACKs with tags {tags[0]} to {tags[-1]} in order", seen)


@GROUP.check("COMMAND")
def rate_one_is_taken(device: Device) -> None:
    """set_rate accepts 1 Hz."""
    expect_rate_taken(device, 1)


@GROUP.check("COMMAND")
def rate_max_is_taken(device: Device) -> None:
    """set_rate accepts rate_max_hz."""
    expect_rate_taken(device, device.info.rate_max_hz)


@GROUP.check("COMMAND")
def rate_zero_is_refused(device: Device) -> None:
    """set_rate refuses 0 as bad_argument, and the rate stays."""
    expect_rate_refused(device, 0)


@GROUP.check("COMMAND")
def rate_above_max_is_refused(device: Device) -> None:
    """set_rate refuses rate_max_hz + 1 as bad_argument, and the rate stays."""
    expect_rate_refused(device, device.info.rate_max_hz + 1)


@GROUP.check("COMMAND")
def rate_above_limit_is_refused(device: Device) -> None:
    """set_rate refuses 201, 65,536 + 100 and 2^32 - 1 as bad_argument: no bits are cut off."""
    for rate_hz in (RATE_LIMIT_HZ + 1, 65_536 + 100, 2**32 - 1):
        expect_rate_refused(device, rate_hz)


@GROUP.check("COMMAND")
def legal_modes_are_taken(device: Device) -> None:
    """set_mode accepts each combination but orient with orient_compact, and tells it in ACK.value."""
    for mode in LEGAL_MODES:
        reply = device.accepted(CommandCode.SET_MODE, mode)
        expect(reply.ack.value == mode, f"ACK.value {mode}, the mode in use", reply.ack.value, reply.frame)
        frame, status = device.get_status()
        expect(status.mode == mode, f"mode {mode} in use", int(status.mode), frame)


@GROUP.check("COMMAND")
def illegal_modes_are_refused(device: Device) -> None:
    """set_mode refuses unknown bits, and orient with orient_compact, as bad_argument, and the mode stays."""
    device.accepted(CommandCode.SET_MODE, Mode.RAW)
    for mode in ILLEGAL_MODES:
        device.answered(AckCode.BAD_ARGUMENT, CommandCode.SET_MODE, mode)
        frame, status = device.get_status()
        expect(status.mode == Mode.RAW, f"mode 4 still after {mode:#x} was refused", int(status.mode), frame)


@GROUP.check("COMMAND")
def identify_limits_are_kept(device: Device) -> None:
    """identify accepts 0 to 60,000 ms and refuses more as bad_argument."""
    try:
        for duration_ms in (1, IDENTIFY_MAX_MS):
            device.accepted(CommandCode.IDENTIFY, duration_ms)
        for duration_ms in (IDENTIFY_MAX_MS + 1, 65_536 * 4, 2**32 - 1):
            device.answered(AckCode.BAD_ARGUMENT, CommandCode.IDENTIFY, duration_ms)
    finally:
        device.try_command(CommandCode.IDENTIFY, 0)
    device.accepted(CommandCode.IDENTIFY, 0)


@GROUP.check("COMMAND")
def enter_dfu_needs_its_key(device: Device) -> None:
    """enter_dfu with another argument than its key is refused, and the device stays."""
    _, before = device.get_status()
    for key in (0, ENTER_DFU_KEY ^ 1, int.from_bytes(ENTER_DFU_KEY.to_bytes(4, "little"), "big")):
        reply = device.command(CommandCode.ENTER_DFU, key)
        refused = reply.ack.code in (AckCode.BAD_ARGUMENT, AckCode.UNSUPPORTED)
        expect(refused, "bad_argument, or unsupported", code_name(reply.ack.code), reply.frame)
    device.receive(0.2)
    frame, after = device.get_status()
    expect(after.uptime_s >= before.uptime_s, "the device to stay up", f"uptime {after.uptime_s} s", frame)
