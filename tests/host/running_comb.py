"""A recorded comb of fakes on TCP ports, some of which may be absent at first."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest
from host.fake_ribbon import FakeRibbon, served
from ribbonhost import wire
from ribbonhost.comb import Comb, CombRibbon
from ribbonhost.device import absent_device, open_device
from ribbonhost.pipeline.arrangement import arrange_comb
from ribbonhost.pipeline.header import header_of, recorded_ribbons
from ribbonhost.pipeline.replay import Replay
from ribbonhost.pipeline.report import Report
from ribbonhost.pipeline.solving import Solved
from ribbonhost.pipeline.stream import Stream
from ribbonhost.record import Recorder, Recording

SERIALS = [f"{i:024x}" for i in range(1, 5)]
COMB = Comb(SERIALS[0], 0.025, tuple(CombRibbon(serial, 0.05 * i) for i, serial in enumerate(SERIALS[1:])))


class Running:
    """A recorded comb of fakes on TCP ports, what it told, and what it made."""

    def __init__(self, stack: ExitStack, path: Path, absent: Sequence[int]) -> None:
        self.fakes = [FakeRibbon(serial=serial, drift_ppm=20.0 * i) for i, serial in enumerate(SERIALS)]
        self.events: list[tuple[str, str]] = []
        self.solved: list[Solved] = []
        self.recorder = Recorder(path)
        self.urls = [stack.enter_context(served(fake)) for fake in self.fakes]
        taps = [self.recorder.tap() for _ in self.fakes]
        for number in absent:
            self.fakes[number].vanish()
        self.devices = [
            absent_device(fake.serial, observer=tap)
            if number in absent
            else open_device(self.urls[number], observer=tap)
            for number, (fake, tap) in enumerate(zip(self.fakes, taps, strict=True))
        ]
        present = [device for number, device in enumerate(self.devices) if number not in absent]
        awaited = {self.devices[number].serial: self.devices[number] for number in absent}
        arrangement = arrange_comb(present, COMB, awaited.__getitem__)
        channels = {device: tap.channel for device, tap in zip(self.devices, taps, strict=True)}
        calibrations: dict[str, wire.Calibration] = {}
        self.stream = Stream(
            arrangement,
            rate_hz=100,
            on_event=lambda *event: self.events.append(event),
            on_solved=[self.solved.append],
            reconnect=True,
            calibrations=calibrations,
            named=[self.urls[number] for number in absent],
            on_joined=lambda device: self.recorder.describe(
                recorded_ribbons(arrangement, channels, calibrations)
            ),
        )
        self.recorder.start(header_of(arrangement, channels, comb=COMB, rate_hz=100, method="spline"))
        stack.callback(self.recorder.close)
        stack.callback(self.stream.close)
        self.stream.start()

    def until(self, condition: Callable[[Report], bool]) -> Report:
        deadline_s = time.monotonic() + 20
        while not condition(report := self.stream.report()):
            assert time.monotonic() < deadline_s, f"did not come true in 20 s: {report} {self.events}"
            time.sleep(0.02)
        return report

    def has_told(self, what: str) -> bool:
        return any(what in told for _, told in self.events)


@contextmanager
def running(path: Path, absent: Sequence[int] = ()) -> Iterator[Running]:
    """absent: the ribbons whose ports are dead until their fakes have not `vanished` any more."""
    with ExitStack() as stack:
        yield Running(stack, path, absent)


def check_replay(path: Path, solved: list[Solved], gone_s: float, ribbon: int = 1) -> None:
    """The recording gives the frames of the stream, to the bit, and the same gap."""
    again: list[Solved] = []
    replay = Replay([Recording(path)], on_solved=[again.append])
    for _ in replay.play():
        pass
    assert replay.damaged == 0
    assert len(again) == len(solved)
    for one, other in zip(solved, again, strict=True):
        assert one.match.t_host_s == other.match.t_host_s
        np.testing.assert_array_equal(one.node_m, other.node_m)
    assert replay.report().ribbons[ribbon].gone_s == pytest.approx(gone_s, abs=1e-6)
