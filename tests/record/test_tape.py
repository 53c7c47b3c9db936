"""A recording may begin and end at any time of a stream; what it must know of the time before comes first."""

import threading
from pathlib import Path

import pytest
from record.conftest import HEADER
from ribbonhost import wire
from ribbonhost.errors import RecordingError
from ribbonhost.record import Event, Received, Recorder, Recording, Sent, Tape, is_complete
from ribbonhost.record.layout import COUNTING
from ribbonhost.record.recorder import EXCHANGES_CARRIED

ASK = wire.encode(wire.Command(tag=7, command=wire.CommandCode.GET_INFO, argument=0, data=b""))
PONG = wire.encode(wire.ClockPong(tag=1, t_host_us=2, t_receive_us=3, t_transmit_us=4))
SCAN = b"\x02 what a scan is made of"


def test_a_recording_that_begins_late_begins_with_what_must_be_known(tmp_path: Path) -> None:
    path = tmp_path / "late.mcap"
    tape = Tape()
    tap = tape.tap()
    tap.sent(ASK, 1.0)
    for k in range(1000):
        tap.received(PONG, 2.0 + 0.001 * k)
        tap.received(SCAN, 2.0 + 0.001 * k)
    tape.event("ribbon 0", "nobody records this")
    tape.begin(Recorder(path), HEADER)
    tap.received(SCAN, 5.0)
    tape.event("ribbon 0", "fell")
    tap.sent(ASK, 6.0)
    tape.end()
    tap.received(SCAN, 7.0)
    assert is_complete(path)
    items = list(Recording(path).items())
    carried = [item for item in items if item.number == 0]
    assert [item.packet for item in carried if isinstance(item, Sent)] == [ASK]
    assert {item.packet for item in carried if isinstance(item, Received)} == {PONG}
    assert len(carried) == 1 + 2 * EXCHANGES_CARRIED
    assert items[: len(carried)] == carried
    own = items[len(carried) :]
    assert [(item.number, item.packet) for item in own if isinstance(item, Received)] == [(1, SCAN)]
    assert [(item.number, item.packet) for item in own if isinstance(item, Sent)] == [(1, ASK)]
    assert [item.what for item in own if isinstance(item, Event)] == [COUNTING, "fell"]


def test_each_recording_of_a_stream_is_a_file_of_its_own_without_a_gap(tmp_path: Path) -> None:
    tape = Tape()
    tap = tape.tap()
    stopping = threading.Event()

    def send() -> None:
        number = 0
        while not stopping.wait(0.0002):
            tap.received(SCAN + number.to_bytes(4, "little"), 10.0 + 0.001 * number)
            number += 1

    sender = threading.Thread(target=send)
    sender.start()
    for name in ("a", "b"):
        tape.begin(Recorder(tmp_path / f"{name}.mcap"), HEADER)
        stopping.wait(0.3)
        tape.end()
    stopping.set()
    sender.join()
    assert len(tape.recorders) == 2
    before = -1
    for name in ("a", "b"):
        received = [i for i in Recording(tmp_path / f"{name}.mcap").items() if isinstance(i, Received)]
        assert [item.number for item in received] == list(range(1, len(received) + 1))
        sent = [int.from_bytes(item.packet[-4:], "little") for item in received]
        assert len(sent) > 20
        assert sent == list(range(sent[0], sent[0] + len(sent)))
        assert sent[0] > before
        before = sent[-1]


def test_a_recording_that_cannot_be_written_leaves_the_stream_without_one(tmp_path: Path) -> None:
    tape = Tape()
    tap = tape.tap()
    recorder = Recorder(tmp_path / "a.mcap")
    (tmp_path / "a.mcap").mkdir()
    with pytest.raises(RecordingError):
        tape.begin(recorder, HEADER)
    assert tape.recorder is None
    assert tape.recorders == []
    tap.received(SCAN, 1.0)
    tape.begin(Recorder(tmp_path / "b.mcap"), HEADER)
    tape.end()
    assert is_complete(tmp_path / "b.mcap")
