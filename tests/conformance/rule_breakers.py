"""Responders that each break one rule: the proof that every check can fail."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from conformance.responder import Responder


@dataclass(frozen=True)
class RuleBreaker:
    """A responder, the check that must find it out, and a pattern of what that must say."""

    name: str
    check: str
    says: str
    responder: type[Responder]


class RuleBreakers(list[RuleBreaker]):
    """The rule breakers of one subject."""

    def breaks(self, check: str, says: str) -> Callable[[type[Responder]], type[Responder]]:
        """Decorator: registers a responder under its own name."""

        def register(responder: type[Responder]) -> type[Responder]:
            self.append(RuleBreaker(responder.__name__, check, says, responder))
            return responder

        return register

    def alters(
        self, check: str, says: str, kind: str, change: Callable[[Any, Responder], dict[str, Any]]
    ) -> None:
        """Registers a responder whose packets of one kind, a method of Responder, have other fields."""

        def altered(self: Responder, *arguments: Any) -> Any:
            packet = getattr(Responder, kind)(self, *arguments)
            return dataclasses.replace(packet, **change(packet, self))

        name = f"{check}_{kind}_{sum(breaker.check == check for breaker in self)}"
        self.append(RuleBreaker(name, check, says, type(name, (Responder,), {kind: altered})))


def altered_array(array: Any, **columns: Any) -> Any:
    """A structure of arrays with other columns; a callable column gets a copy of the old one to change."""
    changed = {}
    for name, column in columns.items():
        values = getattr(array, name).copy()
        column(values)
        changed[name] = values
    return dataclasses.replace(array, **changed)


def put(index: int, value: Any) -> Callable[[Any], None]:
    """Sets one item of a column."""

    def change(values: Any) -> None:
        values[index] = value

    return change
