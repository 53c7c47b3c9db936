"""Tables and words that several commands print."""

import io
import sys
from enum import IntEnum

from rich.console import Console
from rich.table import Table

PIPED_COLUMNS = 1000


def print_table(table: Table) -> None:
    """Coloured and fitted to a terminal; plain, with each row on one line, elsewhere."""
    if sys.stdout.isatty():
        Console(highlight=False).print(table)
        return
    text = io.StringIO()
    Console(file=text, width=PIPED_COLUMNS).print(table)
    for line in text.getvalue().splitlines():
        print(line.rstrip())


def plain_table(*headings: str) -> Table:
    """A table without borders."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in headings:
        table.add_column(heading, overflow="fold")
    return table


def name_of(kind: type[IntEnum], value: int) -> str:
    """What the protocol calls a value; a later device may send one that this host does not know."""
    try:
        return kind(value).name.lower()
    except ValueError:
        return f"unknown ({value})"


def count_names(names: list[str]) -> dict[str, int]:
    """How often each occurs, in the order of first occurrence."""
    return {name: names.count(name) for name in dict.fromkeys(names)}
