"""Packets that wait for the link: only the oldest of the stream is ever lost, and it is counted."""

from __future__ import annotations

from collections import deque

import numpy as np
from ribbonhil._firmware import ffi, lib


class Outbox:
    def __init__(self) -> None:
        self.c = ffi.new("struct outbox *")
        lib.outbox_init(self.c)
        self._packet = ffi.new("uint8_t[]", lib.WIRE_MAX_PACKET_BYTES)

    def stream(self, packet: bytes) -> None:
        lib.outbox_add_stream(self.c, packet, len(packet))

    def reply(self, packet: bytes) -> bool:
        return lib.outbox_add_reply(self.c, packet, len(packet))

    def take(self, capacity: int = lib.WIRE_MAX_PACKET_BYTES) -> bytes:
        return bytes(ffi.buffer(self._packet, lib.outbox_take(self.c, self._packet, capacity)))


def packet(number: int, size: int) -> bytes:
    return number.to_bytes(4, "little") + bytes([number % 251]) * (size - 4)


def test_packets_leave_in_order_and_unchanged():
    outbox = Outbox()
    sent = [packet(i, 100 + i) for i in range(10)]
    for p in sent:
        outbox.stream(p)
    assert [outbox.take() for _ in sent] == sent
    assert outbox.take() == b""
    assert outbox.c.dropped == 0


def test_slower_link_loses_the_oldest_and_counts_them():
    """Of 100 packets of which every third is taken, those kept are the newest, without a gap."""
    outbox = Outbox()
    taken = []
    for i in range(100):
        outbox.stream(packet(i, 120))
        if i % 3 == 0:
            taken.append(outbox.take())
    rest = []
    while p := outbox.take():
        rest.append(p)
    numbers = [int.from_bytes(p[:4], "little") for p in rest]
    assert numbers == list(range(100 - len(rest), 100))
    assert len(taken) + len(rest) + outbox.c.dropped == 100
    assert all(p == packet(int.from_bytes(p[:4], "little"), 120) for p in taken + rest)


def test_replies_leave_before_the_stream_and_are_never_dropped_for_it():
    outbox = Outbox()
    replies = [packet(1000 + i, 50) for i in range(5)]
    outbox.stream(packet(1, 120))
    for reply in replies:
        assert outbox.reply(reply)
    for i in range(200):
        outbox.stream(packet(i, 120))
    assert [outbox.take() for _ in replies] == replies
    assert outbox.take() != b""


def test_reply_that_does_not_fit_is_refused_and_counted():
    outbox = Outbox()
    while outbox.reply(packet(7, 100)):
        assert lib.outbox_has_reply(outbox.c)
    assert outbox.c.dropped == 1
    assert not lib.outbox_has_reply_room(outbox.c, 1, 100)
    count = 0
    while outbox.take() == packet(7, 100):
        count += 1
    assert count == lib.OUTBOX_REPLY_BYTES // 102
    assert not lib.outbox_has_reply(outbox.c)


def test_packet_larger_than_the_queue_is_counted_as_dropped():
    outbox = Outbox()
    outbox.stream(packet(1, 200))
    outbox.stream(bytes(lib.OUTBOX_STREAM_BYTES))
    assert outbox.c.dropped == 1
    assert outbox.take() == packet(1, 200)


def test_random_use_agrees_with_two_lists():
    """20,000 random additions and removals against a model of the same rules."""
    rng = np.random.default_rng(1)
    outbox = Outbox()
    model: dict[str, deque[bytes]] = {"stream": deque(), "reply": deque()}
    dropped = 0
    for i in range(20_000):
        size = int(rng.integers(4, 500))
        match rng.choice(["stream", "reply", "take"], p=[0.45, 0.1, 0.45]):
            case "stream":
                queue = model["stream"]
                while sum(len(p) + 2 for p in queue) + size + 2 > lib.OUTBOX_STREAM_BYTES:
                    queue.popleft()
                    dropped += 1
                queue.append(packet(i, size))
                outbox.stream(packet(i, size))
            case "reply":
                queue = model["reply"]
                fits = sum(len(p) + 2 for p in queue) + size + 2 <= lib.OUTBOX_REPLY_BYTES
                assert outbox.reply(packet(i, size)) == fits
                if fits:
                    queue.append(packet(i, size))
                else:
                    dropped += 1
            case _:
                queue = model["reply"] or model["stream"]
                assert outbox.take() == (queue.popleft() if queue else b"")
        assert outbox.c.dropped == dropped
