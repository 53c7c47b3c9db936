"""What a run found: a table for a person, a JSON object for a program. Both say what was tested."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ribbonhil.check.check import Check, Measurement
from ribbonhil.check.runner import Outcome, Report, Result
from ribbonhil.ran_on import Kind, RanOn

FORMAT = "ribbonhil check 1"
COLOURS = {Outcome.PASSED: "green", Outcome.FAILED: "bold red", Outcome.NOT_RUN: "yellow"}
VERDICTS = {True: "passed", False: "FAILED", None: ""}


def show(ran_on: RanOn, report: Report, console: Console) -> None:
    """Prints what it ran on, the table, why checks failed or did not run, and the summary."""
    console.print(ran_on_text(ran_on), soft_wrap=True)
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("check", overflow="fold")
    table.add_column("measured", justify="right", no_wrap=True)
    for heading in ("limit", "result", "where"):
        table.add_column(heading, overflow="fold")
    for result in report.results:
        name = Text(f"{result.check.topic}: {result.check.name}", "bold")
        table.add_row(name, "", "", Text(result.outcome.value, COLOURS[result.outcome]))
        for measurement in result.measurements:
            table.add_row(*cells(measurement))
    console.print(table)
    console.print()
    for result in report.results:
        if result.reason:
            style = COLOURS[result.outcome]
            why = f"{result.check.name} {result.outcome.value}: {result.reason}"
            console.print(Text(why, style), soft_wrap=True)
    if report.left_changed:
        changed = f"The device is not as it was: {report.left_changed}"
        console.print(Text(changed, COLOURS[Outcome.FAILED]), soft_wrap=True)
    console.print(ran_on_text(ran_on), soft_wrap=True)
    console.print(Text(summary_line(report), COLOURS[Outcome.PASSED if report.passed else Outcome.FAILED]))


def ran_on_text(ran_on: RanOn) -> Text:
    """What was tested; in colour if it is no hardware, so that nobody takes it for that."""
    return Text(f"Ran on: {ran_on}", "" if ran_on.kind is Kind.HARDWARE else "bold yellow")


def cells(measurement: Measurement) -> list[Text]:
    """Quantity, value, limit, verdict and place of one measurement."""
    value = measurement.value if isinstance(measurement.value, str) else f"{measurement.value:.4g}"
    words = (f"  {measurement.what}", f"{value} {measurement.unit}".rstrip(), measurement.limit)
    style = COLOURS[Outcome.FAILED] if measurement.passed is False else ""
    return [*(Text(word, style) for word in (*words, VERDICTS[measurement.passed])), Text(measurement.where)]


def summary_line(report: Report) -> str:
    """How it ended, in one line."""
    counts = [f"{report.count(outcome)} {outcome.value}" for outcome in Outcome]
    stopped = f"; {report.stopped}" if report.stopped else ""
    return f"{len(report.results)} checks in {report.seconds:.1f} s: {', '.join(counts)}{stopped}"


def as_json(ran_on: RanOn, report: Report) -> str:
    """One JSON object with what it ran on and every measurement."""
    document: dict[str, Any] = {
        "format": FORMAT,
        "ended": datetime.now(UTC).isoformat(timespec="seconds"),
        "ran_on": ran_on.as_json(),
        "passed": report.passed,
        "summary": {
            **{outcome.value.replace(" ", "_"): report.count(outcome) for outcome in Outcome},
            "stopped": report.stopped,
            "left_changed": report.left_changed,
            "seconds": round(report.seconds, 3),
        },
        "checks": [_result_json(result) for result in report.results],
    }
    return json.dumps(document, indent=1, allow_nan=False)


def _result_json(result: Result) -> dict[str, Any]:
    return {
        "name": result.check.name,
        "topic": result.check.topic,
        "purpose": result.check.purpose,
        "outcome": result.outcome.value,
        "reason": result.reason,
        "seconds": round(result.seconds, 3),
        "measurements": [
            {
                "what": measurement.what,
                "value": _finite(measurement.value),
                "unit": measurement.unit,
                "low": measurement.low,
                "high": measurement.high,
                "expected": measurement.expected,
                "passed": measurement.passed,
                "where": measurement.where,
            }
            for measurement in result.measurements
        ],
    }


def _finite(value: float | str) -> float | str | None:
    """JSON has no infinity and no NaN: null stands for what never came."""
    return value if isinstance(value, str) or math.isfinite(value) else None


def as_markdown(checks: Sequence[Check]) -> str:
    """The list of checks, as the documentation has it."""
    rows = [f"| {check.topic} | `{check.name}` | {check.purpose} |" for check in checks]
    return "\n".join(["| topic | check | what it looks at, and why |", "|---|---|---|", *rows]) + "\n"
