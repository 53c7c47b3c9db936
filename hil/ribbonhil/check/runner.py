"""Runs checks against one device, and leaves the device as it was found."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from ribbonhost.errors import LinkError, LinkLostError
from ribbonhost.wire import Info, WireError

from ribbonhil.check.bench import Bench
from ribbonhil.check.check import Check, Measurement, NotRunError, Topic
from ribbonhil.conformance.check import BrokenRuleError

TOPICS = ("ids", "rate", "jitter", "loss", "noise", "static_pose", "fault_reaction")
"""The files of hil/checks, in the order in which they run."""


def topics() -> tuple[Topic, ...]:
    """The topic of each file of hil/checks."""
    # By name: hil/checks is ribbonhil.checks only where ribbonhil is installed.
    modules = (importlib.import_module(f"ribbonhil.checks.{name}") for name in TOPICS)
    return tuple(module.TOPIC for module in modules)


class Outcome(Enum):
    """How a check ended."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_RUN = "not run"


@dataclass(frozen=True)
class Result:
    """How one check ended, what it measured, and why it failed without a value or did not run."""

    check: Check
    outcome: Outcome
    measurements: tuple[Measurement, ...] = ()
    reason: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Report:
    """All results. `stopped` says why the run ended early, `left_changed` what could not be put back."""

    info: Info
    results: tuple[Result, ...]
    seconds: float
    stopped: str
    left_changed: str

    def count(self, outcome: Outcome) -> int:
        """Checks that ended so."""
        return sum(result.outcome is outcome for result in self.results)

    @property
    def passed(self) -> bool:
        """Something was checked, nothing failed, the run was not cut short, and the device is as it was."""
        bad = self.count(Outcome.FAILED) or self.stopped or self.left_changed
        return not bad and self.count(Outcome.PASSED) > 0


def run(
    bench: Bench, checks: Sequence[Check], on_start: Callable[[Check], None] = lambda check: None
) -> Report:
    """Runs the checks in order. The device must have been started."""
    device = bench.device
    started_s = device.now_s()
    results: list[Result] = []
    stopped = ""
    for check in checks:
        if stopped:
            results.append(Result(check, Outcome.NOT_RUN, reason=stopped))
            continue
        on_start(check)
        try:
            results.append(_run_one(bench, check))
        except KeyboardInterrupt:
            stopped = "stopped by Ctrl-C"
            results.append(Result(check, Outcome.NOT_RUN, reason=stopped))
        except LinkLostError as lost:
            stopped = str(lost)
            results.append(Result(check, Outcome.FAILED, reason=stopped))
    return Report(device.info, tuple(results), device.now_s() - started_s, stopped, device.leave())


def _run_one(bench: Bench, check: Check) -> Result:
    started_s = bench.device.now_s()
    found: list[Measurement] = []
    outcome, reason = Outcome.PASSED, ""
    try:
        for measurement in check.run(bench):
            found.append(measurement)  # noqa: PERF402 - what was measured before an error is kept
    except LinkLostError:
        raise
    except (NotRunError, LinkError) as why:
        outcome, reason = Outcome.NOT_RUN, str(why)
    except (BrokenRuleError, WireError) as broken:
        outcome, reason = Outcome.FAILED, str(broken)
    if any(measurement.passed is False for measurement in found):
        outcome = Outcome.FAILED
    elif outcome is Outcome.PASSED and not any(measurement.passed for measurement in found):
        outcome, reason = Outcome.NOT_RUN, "it has no limit to hold the device to"
    return Result(check, outcome, tuple(found), reason, bench.device.now_s() - started_s)
