"""An emulated ribbon, the firmware itself in real time, passes the whole suite over its pyserial URL."""

from __future__ import annotations

from ribbonhil.conformance.check import Permission
from ribbonhil.conformance.checks import all_checks
from ribbonhil.conformance.link import SerialLink
from ribbonhil.conformance.runner import Outcome, run

URL = "emulated://wing/0?ribbons=2&seed=3"
LIMIT_S = 40.0


def test_an_emulated_ribbon_passes_every_check() -> None:
    link = SerialLink(URL, 921_600)
    try:
        report = run(link, all_checks(), set(Permission))
    finally:
        link.close()
    failed = {r.check.name: (r.expected, r.seen) for r in report.results if r.outcome is Outcome.FAILED}
    assert failed == {}
    assert report.count(Outcome.PASSED) == len(all_checks())
    assert report.passed
    assert report.seconds < LIMIT_S
