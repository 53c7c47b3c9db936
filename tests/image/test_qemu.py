"""The same ELF file in QEMU, without clock tree, DMA and sensors: it must say so, and keep running."""

from image.programs import built
from image.qemu import Qemu
from ribbonhost.framing import Deframer, encode_frame
from ribbonhost.wire import (
    Ack,
    AckCode,
    Board,
    ClockSource,
    Command,
    CommandCode,
    Info,
    Packet,
    Part,
    SlotReason,
    Status,
    decode,
    encode,
)


def packets(data: bytes) -> list[Packet]:
    """All packets; every frame must be whole but the last one, which may be on its way."""
    deframer = Deframer()
    decoded = [decode(packet)[0] for packet in deframer.feed(data)]
    assert deframer.crc_errors == deframer.malformed == 0
    return decoded


def count(data: bytes, kind: type) -> int:
    return sum(isinstance(packet, kind) for packet in packets(data))


def test_image_says_that_it_has_neither_crystal_nor_sensors_and_keeps_running() -> None:
    with Qemu(built()) as qemu:
        received = packets(qemu.run_until(lambda data: count(data, Status) >= 3))
    info = next(packet for packet in received if isinstance(packet, Info))
    assert info.board == Board.PYBOARD_V11
    assert set(info.slots.part) == {Part.NONE}
    statuses = [packet for packet in received if isinstance(packet, Status)]
    for status in statuses:
        assert status.clock_source == ClockSource.INTERNAL_RC
        assert set(status.slots.reason) == {SlotReason.ABSENT}
        assert status.fault_pc == 0
    assert [s.uptime_s for s in statuses] == sorted({s.uptime_s for s in statuses})
    assert statuses[-1].scans > statuses[0].scans


def test_image_answers_commands_in_qemu() -> None:
    with Qemu(built()) as qemu:
        qemu.run_until(lambda data: count(data, Info) >= 1)
        qemu.write(encode_frame(encode(Command(4711, CommandCode.SET_RATE, 5, b""))))
        qemu.write(encode_frame(encode(Command(4712, CommandCode.ENTER_DFU, 0x21554644, b""))))
        received = packets(qemu.run_until(lambda data: count(data, Ack) >= 2))
    answers = {packet.tag: packet for packet in received if isinstance(packet, Ack)}
    assert (answers[4711].code, answers[4711].value) == (AckCode.OK, 5)
    assert answers[4712].code == AckCode.UNSUPPORTED
