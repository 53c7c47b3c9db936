"""`ribbonhost doctor`: what is in the way of a stream, one line a check, and what to do."""

import json
from collections.abc import Sequence
from pathlib import Path

from rich.text import Text

from ribbonhost.cli.doctor_checks import (
    Check,
    Verdict,
    machine_checks,
    permission_check,
    port_checks,
    ribbon_checks,
)
from ribbonhost.cli.naming import probe
from ribbonhost.cli.printing import plain_table, print_table
from ribbonhost.comb import load_comb
from ribbonhost.errors import RibbonError

STYLES = {Verdict.OK: "green", Verdict.NOTE: "yellow", Verdict.FAIL: "bold red"}


def run_doctor(names: Sequence[str], comb: Path | None, baud: int, as_json: bool) -> None:
    """Makes all checks and prints them. Raises RibbonError if one fails."""
    ports = probe(names, baud=baud, comb=load_comb(comb) if comb else None)
    checks = [*machine_checks(Path.cwd()), permission_check(ports), *port_checks(ports)]
    for port in ports:
        if port.info:
            checks += ribbon_checks(port, baud)
    _print(checks, as_json)
    failed = [check.name for check in checks if check.verdict is Verdict.FAIL]
    if failed:
        verb = "fails" if len(failed) == 1 else "fail"
        raise RibbonError(f"{len(failed)} of {len(checks)} checks {verb}: {', '.join(failed)}")


def _print(checks: Sequence[Check], as_json: bool) -> None:
    if as_json:
        found = [{"name": c.name, "verdict": c.verdict.value.lower(), "what": c.what} for c in checks]
        print(json.dumps({"checks": found}))
        return
    table = plain_table("", "", "")
    table.show_header = False
    for check in checks:
        table.add_row(Text(check.verdict.value, STYLES[check.verdict]), Text(check.name), Text(check.what))
    print_table(table)
