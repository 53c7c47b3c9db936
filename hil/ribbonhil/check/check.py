"""What a check is: a small function that measures, and what each measured value may be."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ribbonhil.check.bench import Bench


class NotRunError(Exception):
    """The check cannot be made here; the message says why, and what would let it run."""


@dataclass(frozen=True)
class Measurement:
    """One value that a check found.

    Attributes:
        what: the quantity.
        value: what was measured, or read.
        unit: of the value, and of low and high; empty for words and counts.
        low, high: what a number may be, None for no limit on that side.
        expected: what a word must be; None for numbers.
        where: the slot, the axis, ... that the value is of, or what else helps to read it.
    """

    what: str
    value: float | str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    expected: str | None = None
    where: str = ""

    @property
    def passed(self) -> bool | None:
        """Whether the value is as it must be; None if it is told and not judged."""
        if self.expected is not None:
            return self.value == self.expected
        if self.low is None and self.high is None:
            return None
        # Anything compared with NaN is false: what could not be computed does not pass.
        number = float(self.value)
        above = self.low is None or number >= self.low
        below = self.high is None or number <= self.high
        return above and below and number == number

    @property
    def limit(self) -> str:
        """What the value must be, in words; empty if it is not judged."""
        if self.expected is not None:
            return self.expected
        if self.low == self.high or (self.low is None and self.high == 0):
            return "" if self.high is None else number_text(self.high)
        if self.low is not None and self.high is not None:
            return f"{number_text(self.low)} to {number_text(self.high)}"
        if self.low is not None:
            return f"at least {number_text(self.low)}"
        return "" if self.high is None else f"at most {number_text(self.high)}"


def number_text(number: float) -> str:
    """A number as a table shows it: five digits."""
    return f"{number:.5g}"


def none_of(what: str, found: Iterable[str]) -> Measurement:
    """How many there are of what must not be; each is told."""
    items = list(found)
    return Measurement(what, len(items), high=0, where=", ".join(items))


@dataclass(frozen=True)
class Check:
    """A named check; `purpose` says what it looks at and why."""

    name: str
    topic: str
    purpose: str
    run: Callable[[Bench], Iterable[Measurement]]


@dataclass
class Topic:
    """The checks of one file, in the order in which they run."""

    name: str
    checks: list[Check] = field(default_factory=list)

    def check(
        self, run: Callable[[Bench], Iterator[Measurement]]
    ) -> Callable[[Bench], Iterator[Measurement]]:
        """Decorator: registers a function under its own name; its docstring is the purpose."""
        purpose = " ".join((run.__doc__ or "").split())
        self.checks.append(Check(run.__name__, self.name, purpose, run))
        return run
