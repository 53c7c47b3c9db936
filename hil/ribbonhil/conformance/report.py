"""What a run found, as a table for a person, a JSON object for a program, and the list of checks."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ribbonhil.conformance.check import Check, Permission
from ribbonhil.conformance.runner import Outcome, Report, Result
from ribbonhil.ran_on import Kind, RanOn

SHOWN_BYTES = 96
COLOURS = {
    Outcome.PASSED: "green",
    Outcome.FAILED: "bold red",
    Outcome.NOT_OBSERVED: "yellow",
    Outcome.NOT_RUN: "yellow",
}


def device_line(url: str, report: Report) -> str:
    """Who was tested."""
    info = report.info
    return (
        f"Ran on: {RanOn(url, info)}; {len(info.slots)} slots, wire version {info.wire_version}, "
        f"at most {info.rate_max_hz} Hz"
    )


def summary_line(report: Report) -> str:
    """How it ended, in one line."""
    counts = [f"{report.count(Outcome.PASSED)} passed", f"{report.count(Outcome.FAILED)} failed"]
    counts += [
        f"{report.count(outcome)} {outcome.value}"
        for outcome in (Outcome.NOT_OBSERVED, Outcome.NOT_RUN)
        if report.count(outcome)
    ]
    return f"{len(report.results)} checks in {report.seconds:.1f} s: {', '.join(counts)}"


def show(url: str, report: Report, console: Console) -> None:
    """Prints the table, what shows each failure, why others were not tested, and the summary."""
    table = Table(box=None, pad_edge=False)
    for heading in ("group", "check", "result"):
        table.add_column(heading, no_wrap=True)
    for result in report.results:
        style = COLOURS[result.outcome]
        table.add_row(result.check.group, result.check.name, Text(result.outcome.value, style=style))
    console.print(table)
    for result in report.results:
        if result.outcome is Outcome.FAILED:
            console.print(Text(f"\n{result.check.name} failed", style=COLOURS[Outcome.FAILED]))
            console.print(Text(explanation(result)))
    console.print()
    for outcome in (Outcome.NOT_OBSERVED, Outcome.NOT_RUN):
        for reason in dict.fromkeys(r.seen for r in report.results if r.outcome is outcome):
            names = [r.check.name for r in report.results if (r.outcome, r.seen) == (outcome, reason)]
            console.print(Text(f"{outcome.value}, as {reason}: {', '.join(names)}", style=COLOURS[outcome]))
    console.print(Text(device_line(url, report)))
    if report.stopped:
        console.print(Text(f"The run ended early: {report.stopped}"))
    console.print(Text(summary_line(report), style="green" if report.passed else "bold red"))


def explanation(result: Result) -> str:
    """Of a failed check: the rule, what was expected and seen, in which bytes, and where it is stated."""
    check = result.check
    lines = [f"rule      {check.rule}", f"expected  {result.expected}", f"seen      {result.seen}"]
    if result.offending:
        more = len(result.offending) - SHOWN_BYTES
        shown = result.offending[:SHOWN_BYTES].hex(" ")
        lines.append(f"bytes     {shown}{f' and {more} more' if more > 0 else ''}")
    return "\n".join([*lines, f"clause    {where(check)}"])


def where(check: Check) -> str:
    """Where the rule is stated."""
    return f"protocol/PROTOCOL.md, {check.clause}"


def as_json(url: str, report: Report) -> str:
    """One JSON object with every result."""
    info = report.info
    kind = RanOn(url, info).kind
    document: dict[str, Any] = {
        "url": url,
        "kind": kind.value,
        "emulated": kind in (Kind.MODULE, Kind.IMAGE),
        "device": {
            "serial": bytes(info.unique_id).hex(),
            "firmware_version": list(info.firmware_version),
            "board": int(info.board),
            "wire_version": info.wire_version,
            "schema_hash": info.schema_hash,
            "slots": len(info.slots),
            "rate_max_hz": info.rate_max_hz,
        },
        "checks": [
            {
                "name": result.check.name,
                "group": result.check.group,
                "rule": result.check.rule,
                "clause": where(result.check),
                "outcome": result.outcome.value,
                "seconds": round(result.seconds, 3),
                "expected": result.expected,
                "seen": result.seen,
                "bytes": result.offending.hex(),
            }
            for result in report.results
        ],
        "summary": {
            **{outcome.value.replace(" ", "_"): report.count(outcome) for outcome in Outcome},
            "passed_all": report.passed,
            "stopped": report.stopped,
            "left_changed": report.left_changed,
            "seconds": round(report.seconds, 3),
        },
    }
    return json.dumps(document)


def as_markdown(checks: Sequence[Check]) -> str:
    """The list of checks, a table a group."""
    lines: list[str] = []
    group = ""
    for check in checks:
        if check.group != group:
            group = check.group
            lines += ["", f"### {group}", "", "| check | rule | clause |", "|---|---|---|"]
        permission = {
            Permission.ALWAYS: "",
            Permission.CALIBRATION_WRITE: " *Writes calibration.*",
            Permission.DFU: " *Only with `--dfu`.*",
        }[check.permission]
        lines.append(f"| `{check.name}` | {check.rule}{permission} | {check.clause} |")
    return "\n".join(lines[1:]) + "\n"
