"""Every check passes on a right responder, and fails on one that breaks its rule."""

from __future__ import annotations

import re

import pytest
from conformance import (
    breakers_calibration,
    breakers_clock,
    breakers_commands,
    breakers_framing,
    breakers_info,
    breakers_status,
    breakers_stream,
)
from conformance.responder import Responder
from conformance.rule_breakers import RuleBreaker
from ribbonhil.conformance.check import Check, Permission
from ribbonhil.conformance.checks import all_checks
from ribbonhil.conformance.runner import Outcome, Report, run

CHECKS = {check.name: check for check in all_checks()}
BREAKERS: list[RuleBreaker] = [
    *breakers_info.BREAKERS,
    *breakers_framing.BREAKERS,
    *breakers_stream.BREAKERS,
    *breakers_status.BREAKERS,
    *breakers_commands.BREAKERS,
    *breakers_clock.BREAKERS,
    *breakers_calibration.BREAKERS,
]


def run_all(responder: Responder, *checks: Check) -> Report:
    return run(responder, checks or all_checks(), set(Permission))


def failures(report: Report) -> dict[str, str]:
    return {
        r.check.name: f"expected {r.expected}, saw {r.seen}"
        for r in report.results
        if r.outcome is Outcome.FAILED
    }


@pytest.mark.parametrize("breaker", BREAKERS, ids=lambda breaker: f"{breaker.check}-{breaker.name}")
def test_a_broken_rule_is_found_by_its_check(breaker: RuleBreaker) -> None:
    result = run_all(breaker.responder(), CHECKS[breaker.check]).results[0]
    assert result.outcome is Outcome.FAILED, breaker.name
    assert re.search(breaker.says, f"expected {result.expected}, saw {result.seen}")


def test_every_check_can_fail() -> None:
    assert {breaker.check for breaker in BREAKERS} == set(CHECKS)
