"""What a check is: one rule of the protocol, and how its breach is told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ribbonhil.conformance.client import Frame
    from ribbonhil.conformance.device import Device


class BrokenRuleError(Exception):
    """A rule is broken: what the rule expects, what was seen, and the bytes that show it."""

    def __init__(self, expected: str, seen: object, offending: bytes = b"") -> None:
        super().__init__(f"expected {expected}, saw {seen}")
        self.expected = expected
        self.seen = str(seen)
        self.offending = offending


class NotObservedError(Exception):
    """The device gave no occasion to see the rule kept or broken."""


class Permission(Enum):
    """What the user may forbid or must allow, because it outlasts the run."""

    ALWAYS = "always"
    CALIBRATION_WRITE = "calibration write"
    DFU = "dfu"


@dataclass(frozen=True)
class Check:
    """A named rule. `clause` is the heading of protocol/PROTOCOL.md that states it."""

    name: str
    group: str
    clause: str
    rule: str
    permission: Permission
    run: Callable[[Device], None]


@dataclass
class Group:
    """Checks of one subject, in the order in which they run."""

    name: str
    checks: list[Check] = field(default_factory=list)

    def check(
        self, clause: str, permission: Permission = Permission.ALWAYS
    ) -> Callable[[Callable[[Device], None]], Callable[[Device], None]]:
        """Decorator: registers a function under its own name; the first line of its docstring is the rule."""

        def register(run: Callable[[Device], None]) -> Callable[[Device], None]:
            rule = " ".join((run.__doc__ or "").split())
            self.checks.append(Check(run.__name__, self.name, clause, rule, permission, run))
            return run

        return register


def expect(holds: bool, expected: str, seen: object, *frames: Frame) -> None:
    """Raises `BrokenRuleError` unless the rule holds; `frames` are what shows the breach."""
    if not holds:
        raise BrokenRuleError(expected, seen, b"".join(frame.coded + b"\0" for frame in frames))
