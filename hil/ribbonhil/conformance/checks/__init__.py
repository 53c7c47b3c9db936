"""All checks, by subject, in the order in which they run."""

from __future__ import annotations

from ribbonhil.conformance.check import Check
from ribbonhil.conformance.checks import (
    calibration,
    clock,
    commands,
    dfu,
    framing,
    info,
    modes,
    phase,
    raw,
    status,
    stream,
)

GROUPS = (
    info.GROUP,
    framing.GROUP,
    stream.GROUP,
    raw.GROUP,
    modes.GROUP,
    status.GROUP,
    commands.GROUP,
    phase.GROUP,
    clock.GROUP,
    calibration.GROUP,
    dfu.GROUP,
)


def all_checks() -> tuple[Check, ...]:
    """Every check once; names are unique."""
    return tuple(check for group in GROUPS for check in group.checks)
