"""A run judges rightly as a whole, ends in time, and leaves the device as it found it."""

from __future__ import annotations

import pytest
from conformance.breakers_calibration import CommitsNothing, UsesWhatItRefuses, WritesInPlace
from conformance.breakers_framing import DiesOfGarbage
from conformance.responder import Responder
from conformance.right_responders import RIGHT_RESPONDERS, Running
from ribbonhil.conformance.check import Check, Permission
from ribbonhil.conformance.checks import all_checks
from ribbonhil.conformance.runner import Outcome, Report, run
from ribbonhost import wire
from ribbonhost.errors import LinkLostError, NoAnswerError, WireVersionError
from ribbonhost.wire import AckCode, Mode

CALIBRATION_CHECKS = tuple(check for check in all_checks() if check.group == "calibration")
INFO_CHECKS = tuple(check for check in all_checks() if check.group == "info")
NO_DFU = {Permission.ALWAYS, Permission.CALIBRATION_WRITE}


def run_all(responder: Responder, checks: tuple[Check, ...] = all_checks()) -> Report:
    return run(responder, checks, set(Permission))


def failures(report: Report) -> dict[str, str]:
    return {
        result.check.name: f"expected {result.expected}, saw {result.seen}"
        for result in report.results
        if result.outcome is Outcome.FAILED
    }


@pytest.mark.parametrize("responder", RIGHT_RESPONDERS[1:], ids=lambda responder: responder.__name__)
def test_a_right_device_passes_every_check(responder: type[Responder]) -> None:
    report = run_all(responder())
    assert failures(report) == {}
    assert report.passed


def test_on_a_device_that_starts_every_check_is_observed() -> None:
    report = run_all(Responder())
    assert report.count(Outcome.PASSED) == len(all_checks())
    assert report.seconds < 40.0


def test_a_start_that_was_not_seen_is_said_to_be_so() -> None:
    report = run_all(Running(), INFO_CHECKS)
    assert [r.check.name for r in report.results if r.outcome is Outcome.NOT_OBSERVED] == [
        "info_comes_at_start"
    ]


@pytest.mark.parametrize(
    "responder", [Responder, UsesWhatItRefuses, WritesInPlace, CommitsNothing], ids=lambda r: r.__name__
)
def test_record_rate_and_mode_are_as_before(responder: type[Responder]) -> None:
    device = responder()
    before = (device.record, 50, Mode.ORIENT | Mode.RAW)
    device.rate_hz, device.mode = before[1:]
    report = run(device, CALIBRATION_CHECKS, NO_DFU)
    assert (device.record, device.rate_hz, device.mode) == before
    assert report.left_changed == ""


@pytest.mark.parametrize("check", CALIBRATION_CHECKS, ids=lambda check: check.name)
def test_a_single_check_leaves_the_record_of_a_device_that_writes_in_place(check: Check) -> None:
    device = WritesInPlace()
    before = device.record
    run_all(device, (check,))
    assert device.record == before


def test_without_permission_nothing_is_written() -> None:
    device = Responder()
    device.commands = {
        code: handler
        for code, handler in device.commands.items()
        if "CALIBRATION_" not in wire.CommandCode(code).name
    } | {wire.CommandCode.CALIBRATION_READ: device.calibration_read}
    report = run(device, CALIBRATION_CHECKS, {Permission.ALWAYS})
    assert report.passed
    assert report.count(Outcome.NOT_RUN) == sum(
        check.permission is Permission.CALIBRATION_WRITE for check in CALIBRATION_CHECKS
    )
    assert report.count(Outcome.NOT_RUN) > 0


class RecordUnlikeInfo(Responder):
    """What is read back is not the record in use: writing it back would destroy that."""

    commits = 0

    def calibration_read(self, argument: int, data: bytes) -> tuple[AckCode, int, bytes]:
        code, size, data = super().calibration_read(argument, data)
        return code, size, bytes(byte ^ 0x20 for byte in data)

    def calibration_commit(self, argument: int, data: bytes) -> tuple[AckCode, int, bytes]:
        self.commits += 1
        return super().calibration_commit(argument, data)


def test_nothing_is_committed_to_a_device_whose_record_cannot_be_read() -> None:
    device = RecordUnlikeInfo()
    report = run_all(device, CALIBRATION_CHECKS)
    assert device.commits == 0
    assert "commit_puts_a_record_in_use" in failures(report)


class FlashOfOneWrite(Responder):
    """Takes one commit, then its store is worn out."""

    def calibration_commit(self, argument: int, data: bytes) -> tuple[AckCode, int, bytes]:
        if self.calibration_sequence:
            return AckCode.STORAGE_FAILED, 0, b""
        return super().calibration_commit(argument, data)


def test_a_record_that_cannot_be_put_back_is_told_and_kept() -> None:
    device = FlashOfOneWrite()
    original = device.record
    report = run_all(device, CALIBRATION_CHECKS)
    assert "calibration record could not be put back" in report.left_changed
    assert "storage_failed" in report.left_changed
    assert report.unrestored_calibration == original
    assert not report.passed


def test_a_device_that_dies_ends_the_run() -> None:
    report = run_all(DiesOfGarbage())
    assert "answers no more since garbage_is_survived" in report.stopped
    assert report.results[-1].outcome is Outcome.NOT_RUN
    assert not report.passed
    assert report.seconds < 60.0


class Unplugged(Responder):
    """Vanishes in the middle of a run."""

    def read(self, timeout_s: float) -> tuple[bytes, float]:
        if self.t_us > 3_000_000:
            raise LinkLostError("/dev/ttyACM0 vanished")
        return super().read(timeout_s)


def test_a_link_that_breaks_ends_the_run() -> None:
    report = run_all(Unplugged())
    assert report.stopped == "/dev/ttyACM0 vanished"
    assert "/dev/ttyACM0 vanished" in report.left_changed
    assert report.count(Outcome.FAILED) == 1


class Interrupted(Responder):
    """Its user presses Ctrl-C while another record is in use."""

    pressed = False

    def read(self, timeout_s: float) -> tuple[bytes, float]:
        if self.calibration_sequence == 1 and not self.pressed:
            self.pressed = True
            raise KeyboardInterrupt
        return super().read(timeout_s)


def test_an_interrupted_run_leaves_the_device_as_it_was() -> None:
    device = Interrupted()
    before = device.record
    report = run_all(device, CALIBRATION_CHECKS)
    assert device.calibration_sequence == 2
    assert device.record == before
    assert report.stopped == "stopped by Ctrl-C"
    assert not report.passed
    assert report.left_changed == ""


class Silent(Responder):
    """Never starts."""

    power_on_us = 2**61


class Noisy(Silent):
    """A terminal, or the right port at the wrong speed."""

    def read(self, timeout_s: float) -> tuple[bytes, float]:
        super().read(timeout_s)
        return b"login: \x00\xff\x81", self.now_s()


class StreamingOnly(Responder):
    """Sends, but does not listen."""

    def on_command(self, content: bytes) -> None:
        pass


class Endless(Silent):
    """Sends bytes without a delimiter for ever."""

    def read(self, timeout_s: float) -> tuple[bytes, float]:
        super().read(min(timeout_s, 0.001))
        return b"\x55" * 500, self.now_s()


@pytest.mark.parametrize(
    ("responder", "says"),
    [
        (Silent, "Nothing answered in 3 s"),
        (Noisy, "bytes came in 3 s, but no packet"),
        (Endless, "bytes came in 3 s, but no packet"),
        (StreamingOnly, "acknowledges no command"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_what_does_not_answer_is_said_in_a_sentence(responder: type[Responder], says: str) -> None:
    with pytest.raises(NoAnswerError, match=says):
        run_all(responder())


class TooNew(Responder):
    """Works with later hosts only."""

    def info(self) -> wire.Info:
        import dataclasses

        return dataclasses.replace(super().info(), wire_version=9, oldest_host_version=9)


def test_a_device_that_needs_a_later_host_is_told_apart() -> None:
    with pytest.raises(WireVersionError, match="version 9"):
        run_all(TooNew())
