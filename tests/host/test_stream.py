"""Devices to surfaces in real time: ribbons that fail, fall silent or vanish do not stop the others."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from host.fake_ribbon import NODES, FakeRibbon
from ribbonhost import wire
from ribbonhost.comb import Comb, CombRibbon
from ribbonhost.device import Device
from ribbonhost.errors import CommandRefusedError, DeviceError
from ribbonhost.link import Link
from ribbonhost.pipeline.arrangement import arrange_comb, arrange_curves
from ribbonhost.pipeline.report import Report
from ribbonhost.pipeline.stream import Stream

SERIALS = [f"{i:024x}" for i in range(1, 5)]
COMB = Comb(SERIALS[0], 0.025, tuple(CombRibbon(serial, 0.05 * i) for i, serial in enumerate(SERIALS[1:])))


def ribbons(count: int = 4) -> list[FakeRibbon]:
    """Ribbons whose clocks have nothing in common; that of the second is about to wrap."""
    return [
        FakeRibbon(
            serial=SERIALS[i],
            drift_ppm=40.0 * i - 60,
            clock_offset_us=(1 << 32) - 300_000 - int(time.monotonic() * 1e6) if i == 1 else i * 777_777_777,
        )
        for i in range(count)
    ]


class Running:
    """A stream over fakes, what it told, and its reports."""

    def __init__(self, fakes: list[FakeRibbon], comb: Comb | None) -> None:
        self.devices = [Device(Link(fake, f"port {i}")) for i, fake in enumerate(fakes)]
        for device in self.devices:
            device.handshake()
        arrangement = arrange_comb(self.devices, comb) if comb else arrange_curves(self.devices)
        self.events: list[tuple[str, str]] = []
        straight_m = np.zeros((4, NODES, 3))
        straight_m[:, :, 0] = np.arange(1, 2 * NODES, 2) * 0.025
        straight_m[1:, :, 0] += np.array([0.0, 0.05, 0.10])[:, None]
        self.stream = Stream(
            arrangement,
            rate_hz=100,
            truth=(lambda _: straight_m) if comb else None,
            on_event=lambda *event: self.events.append(event),
        )

    def until(self, condition: Callable[[Report], bool]) -> Report:
        deadline_s = time.monotonic() + 10
        while not condition(report := self.stream.report()):
            assert time.monotonic() < deadline_s, f"did not come true in 10 s: {report}"
            time.sleep(0.02)
        return report

    def after_frames(self, count: int) -> Report:
        return self.until(lambda report: report.comb.frames >= count)


@contextmanager
def running(fakes: list[FakeRibbon], comb: Comb | None = COMB) -> Iterator[Running]:
    run = Running(fakes, comb)
    try:
        run.stream.start()
        yield run
    finally:
        run.stream.close()
        for device in run.devices:
            device.close()


def test_a_comb_streams_without_loss_and_stops_quietly() -> None:
    fakes = ribbons()
    with running(fakes) as run:
        report = run.after_frames(50)
    for ribbon in report.ribbons:
        assert ribbon.state == "streaming"
        assert ribbon.counters.frames >= 48
        assert ribbon.counters.lost == 0
        assert ribbon.aligned
        assert ribbon.clock_restarts == 0
        assert abs(ribbon.latency_p50_s) < 1.0
    assert report.comb.surfaces >= report.comb.frames - 1  # one may be in the making
    assert report.comb.error_mean_percent < 1e-9, "straight ribbons, known exactly"
    assert [fake.mode for fake in fakes] == [0] * 4
    assert all(fake.closed for fake in fakes)
    assert not [thread.name for thread in threading.enumerate() if thread.name in ("keeper", "reconstruct")]


def test_scans_are_made_to_end_together() -> None:
    """Within 1 ms on host clocks that nobody disturbs; the fakes read one and the same clock."""
    fakes = ribbons()
    with running(fakes) as run:
        run.after_frames(30)
        ends_us = np.array(
            [(fake.scan_ends_us[-1] - fake.clock_offset_us) / (1 + fake.drift_ppm * 1e-6) for fake in fakes]
        )
    apart_us = (ends_us - ends_us[0] + 5_000) % 10_000 - 5_000
    assert np.abs(apart_us).max() < 1_000


def test_scans_that_drifted_apart_are_aligned_again() -> None:
    fakes = ribbons()
    fakes[2].drift_ppm = 900.0
    with running(fakes) as run:
        run.until(lambda _: sum(code == wire.CommandCode.SET_PHASE for code, _ in fakes[2].commands) >= 3)


def test_a_ribbon_that_knows_no_phase_runs_free_and_it_is_said() -> None:
    fakes = ribbons()
    fakes[2].refused = {wire.CommandCode.SET_PHASE: wire.AckCode.UNKNOWN_COMMAND}
    with running(fakes) as run:
        report = run.after_frames(30)
    assert [ribbon.aligned for ribbon in report.ribbons] == [True, True, False, True]
    assert report.ribbons[2].counters.frames >= 28
    assert any(label == "at 0.05 m" and "unknown_command" in what for label, what in run.events)


def test_a_silent_ribbon_is_bridged_and_comes_back_by_itself() -> None:
    fakes = ribbons()
    with running(fakes) as run:
        fakes[2].paused = True
        run.until(lambda report: report.ribbons[2].state == "silent")
        before = run.stream.report()
        after = run.after_frames(before.comb.frames + 30)
        assert after.comb.surfaces > before.comb.surfaces, "the others go on"
        fakes[2].paused = False
        run.until(lambda report: report.ribbons[2].state == "streaming")
        report = run.after_frames(after.comb.frames + 30)
    assert report.ribbons[2].counters.lost >= 40
    assert report.ribbons[0].counters.lost == 0
    assert [what for label, what in run.events if label == "at 0.05 m"] == [
        "delivered nothing for 0.5 s: not waited for",
        "delivers again",
    ]


def test_a_ribbon_that_vanishes_is_told_at_once_and_the_others_go_on() -> None:
    fakes = ribbons()
    with running(fakes) as run:
        fakes[3].vanish()
        report = run.until(lambda report: report.ribbons[3].state == "gone")
        run.until(lambda _: run.events)
        assert run.events[0][0] == "at 0.1 m"
        assert "vanished" in run.events[0][1]
        after = run.after_frames(report.comb.frames + 80)
        assert after.comb.surfaces > report.comb.surfaces
        assert run.stream.over == ""
        fakes[0].vanish()
        run.until(lambda _: "the reference ribbon is gone" in run.stream.over)


def test_a_ribbon_that_was_reset_is_set_up_again() -> None:
    fakes = ribbons()
    with running(fakes) as run:
        run.after_frames(10)
        fakes[1].reset()
        run.until(lambda _: fakes[1].rate_hz == 100)
        report = run.until(lambda report: report.ribbons[1].aligned)
        run.until(lambda now: now.ribbons[1].counters.frames > report.ribbons[1].counters.frames + 20)
    assert any("started anew" in what for _, what in run.events)


def test_a_ribbon_that_cannot_be_set_up_is_left_out() -> None:
    fakes = ribbons()
    fakes[1].refused = {wire.CommandCode.SET_RATE: wire.AckCode.BAD_ARGUMENT}
    fakes[2].pongs = False
    with running(fakes) as run:
        report = run.after_frames(20)
    assert [ribbon.state for ribbon in report.ribbons] == ["streaming", "missing", "missing", "streaming"]
    assert report.comb.surfaces == 0, "one ribbon beside the reference makes no surface"
    told = dict(run.events)
    assert "refused set_rate 100: bad_argument" in told["at 0 m"]
    assert "does not answer clock pings" in told["at 0.05 m"]


def test_a_reference_that_cannot_be_set_up_ends_it() -> None:
    fakes = ribbons()
    fakes[0].refused = {wire.CommandCode.SET_MODE: wire.AckCode.UNSUPPORTED}
    with pytest.raises(CommandRefusedError), running(fakes):
        pass
    fakes = ribbons(1)
    fakes[0].pongs = False
    with pytest.raises(DeviceError, match="does not answer clock pings"), running(fakes, None):
        pass
    assert fakes[0].closed


def test_corrupt_frames_are_counted_and_the_others_make_surfaces() -> None:
    fakes = ribbons()
    count = iter(range(1_000_000))
    with running(fakes) as run:
        fakes[1].spoil = lambda frame: frame[:9] + b"\x01" + frame[10:] if next(count) % 5 == 0 else frame
        report = run.after_frames(60)
    bad = report.ribbons[1].counters
    assert bad.crc_errors + bad.malformed >= 5
    assert bad.lost >= 3
    assert report.ribbons[0].counters.lost == 0
    assert report.comb.surfaces >= report.comb.frames - 1  # one may be in the making


def test_nodes_that_stay_invalid_are_counted_and_bridged() -> None:
    fakes = ribbons()
    fakes[1].valid = [True, False, True, True]
    fakes[2].valid = [False] * NODES
    with running(fakes) as run:
        report = run.after_frames(20)
    assert report.ribbons[1].counters.invalid_nodes == report.ribbons[1].counters.frames
    assert report.ribbons[2].counters.invalid_nodes == NODES * report.ribbons[2].counters.frames
    assert report.comb.surfaces >= report.comb.frames - 1  # one may be in the making
    assert report.comb.error_mean_percent < 1e-9


def test_ribbons_without_a_comb_give_curves_each_for_itself() -> None:
    fakes = ribbons(2)
    with running(fakes, None) as run:
        fakes[1].paused = True
        report = run.after_frames(40)
    assert report.comb.surfaces == 0
    assert report.comb.frames >= 40
    assert report.ribbons[0].held == 0


def test_scans_that_come_too_fast_are_dropped_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ribbonhost.pipeline.stream.QUEUE_SCANS", 0)
    monkeypatch.setattr("ribbonhost.pipeline.stream.SETTLE_S", 0.1)
    with running(ribbons(2), None) as run:
        report = run.until(lambda report: report.comb.dropped >= 10)
    assert report.comb.frames == 0
