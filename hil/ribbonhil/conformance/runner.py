"""Runs checks against one device, and leaves the device as it was found."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from enum import Enum

from ribbonhost.errors import LinkLostError
from ribbonhost.wire import CommandCode, Info

from ribbonhil.conformance.check import BrokenRuleError, Check, NotObservedError, Permission
from ribbonhil.conformance.device import Device
from ribbonhil.conformance.link import Link

STILL_THERE_TRIES = 3


class Outcome(Enum):
    """How a check ended."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_OBSERVED = "not observed"
    NOT_RUN = "not run"


@dataclass(frozen=True)
class Result:
    """How one check ended; `seen` also says why it was not observed or not run."""

    check: Check
    outcome: Outcome
    seconds: float = 0.0
    expected: str = ""
    seen: str = ""
    offending: bytes = b""


@dataclass(frozen=True)
class Report:
    """All results. `left_changed` says what could not be put back, empty if all was."""

    info: Info
    results: tuple[Result, ...]
    seconds: float
    stopped: str
    left_changed: str
    unrestored_calibration: bytes

    def count(self, outcome: Outcome) -> int:
        """Checks that ended so."""
        return sum(result.outcome is outcome for result in self.results)

    @property
    def passed(self) -> bool:
        """No rule was seen broken, all permitted checks ran, and the device is as it was."""
        return not (self.count(Outcome.FAILED) or self.stopped or self.left_changed)


def run(
    link: Link,
    checks: Sequence[Check],
    permitted: Collection[Permission],
    on_start: Callable[[Check], None] = lambda check: None,
) -> Report:
    """Runs the checks in order.

    Raises NoAnswerError, WireVersionError or LinkLostError if there is no device to test.
    """
    device = Device(link)
    device.start()
    started_s = device.now_s()
    results: list[Result] = []
    stopped = ""
    for check in checks:
        if stopped:
            results.append(Result(check, Outcome.NOT_RUN, seen=stopped))
        elif check.permission not in permitted:
            results.append(Result(check, Outcome.NOT_RUN, seen=f"{check.permission.value} is not permitted"))
        else:
            on_start(check)
            try:
                results.append(_run_one(device, check))
                stopped = _why_stopped(device, results[-1])
            except KeyboardInterrupt:
                stopped = "stopped by Ctrl-C"
                results.append(Result(check, Outcome.NOT_RUN, seen=stopped))
    left_changed = device.leave()
    return Report(
        device.info,
        tuple(results),
        device.now_s() - started_s,
        stopped,
        left_changed,
        device.original_record if left_changed and device.original_record else b"",
    )


def _run_one(device: Device, check: Check) -> Result:
    started_s = device.now_s()

    def ended(outcome: Outcome, expected: str = "", seen: str = "", offending: bytes = b"") -> Result:
        return Result(check, outcome, device.now_s() - started_s, expected, seen, offending)

    try:
        device.quiet()
        writes = check.permission is Permission.CALIBRATION_WRITE
        with device.calibration_kept() if writes else nullcontext():
            check.run(device)
    except BrokenRuleError as failed:
        return ended(Outcome.FAILED, failed.expected, failed.seen, failed.offending)
    except NotObservedError as reason:
        return ended(Outcome.NOT_OBSERVED, seen=str(reason))
    except LinkLostError as lost:
        return ended(Outcome.FAILED, "a link that stays open", str(lost))
    return ended(Outcome.PASSED)


def _why_stopped(device: Device, last: Result) -> str:
    """Empty while the device still answers; only a failed check is a reason to ask."""
    if last.outcome is not Outcome.FAILED:
        return ""
    try:
        for _ in range(STILL_THERE_TRIES):
            if device.try_command(CommandCode.GET_INFO):
                return ""
    except LinkLostError as lost:
        return str(lost)
    return f"the device answers no more since {last.check.name}"
