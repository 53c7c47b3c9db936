"""Worst-case stack of an image, out of the call graph that gcc wrote beside each object."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

# What an exception puts on the stack: 26 words with floating point, and up to one for alignment to 8 bytes.
EXCEPTION_FRAME_BYTES = 27 * 4

INDIRECT = "__indirect_call"

# Functions of newlib and libgcc come without stack figures. Each entry is larger than what it pushes and is
# a leaf; a function that is not here fails the build.
LIBRARY_BYTES = {"memcpy": 32, "memset": 32, "memcmp": 32, "memmove": 32}

_NODE = re.compile(r'node: \{ title: "([^"]+)" label: "([^"]*)"')
_EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
_SIZE = re.compile(r"\\n(\d+) bytes \(([a-z,]+)\)")


class StackError(Exception):
    """The call graph has no worst case, or not one that can be computed."""


@dataclass
class CallGraph:
    """Frame size in bytes of each function, and whom it calls."""

    frame_bytes: dict[str, int] = field(default_factory=dict)
    callees: dict[str, set[str]] = field(default_factory=dict)


def read_call_graph(paths: Iterable[Path]) -> CallGraph:
    """The graph of all objects together. Raises StackError for a frame whose size is not fixed."""
    graph = CallGraph()
    for path in paths:
        text = path.read_text()
        for title, label in _NODE.findall(text):
            size = _SIZE.search(label)
            if size is None:
                continue
            if size[2] != "static":
                raise StackError(f"{title} has a frame of unbounded size ({size[2]})")
            graph.frame_bytes[title] = int(size[1])
        for caller, callee in _EDGE.findall(text):
            graph.callees.setdefault(caller, set()).add(callee)
    return graph


def read_indirect_calls(path: Path) -> dict[str, set[str]]:
    """Lines of "caller: callee callee ..."; # starts a comment."""
    calls: dict[str, set[str]] = {}
    for line in path.read_text().splitlines():
        line = line.split("#")[0].strip()
        if line:
            caller, _, callees = line.partition(":")
            calls[caller.strip()] = set(callees.split())
    return calls


def _resolve(graph: CallGraph, name: str) -> str:
    """A static function is known to gcc as file.c:name."""
    if name in graph.frame_bytes:
        return name
    matches = [title for title in graph.frame_bytes if title.endswith(f":{name}")]
    if len(matches) != 1:
        raise StackError(f"{len(matches)} functions are called {name}")
    return matches[0]


def add_indirect_calls(graph: CallGraph, calls: dict[str, set[str]]) -> None:
    """Replaces each call through a pointer by the functions it can reach."""
    declared = {
        _resolve(graph, caller): {_resolve(graph, c) for c in callees} for caller, callees in calls.items()
    }
    for caller, callees in graph.callees.items():
        if INDIRECT in callees:
            if caller not in declared:
                raise StackError(
                    f"{caller} calls through a pointer: say in indirect_calls.txt what it reaches"
                )
            callees.remove(INDIRECT)
            callees |= declared.pop(caller)
    if declared:
        raise StackError(f"{', '.join(sorted(declared))} of indirect_calls.txt do not call through a pointer")


def deepest(graph: CallGraph, root: str) -> tuple[int, list[str]]:
    """Bytes of stack that `root` and all below it need at most, and the chain of calls that does.

    Raises StackError for recursion and for a function without a frame size."""
    known: dict[str, tuple[int, list[str]]] = {}

    def visit(name: str, above: tuple[str, ...]) -> tuple[int, list[str]]:
        if name in above:
            raise StackError(f"recursion: {' -> '.join((*above[above.index(name) :], name))}")
        if name not in known:
            own = graph.frame_bytes.get(name, LIBRARY_BYTES.get(name))
            if own is None:
                raise StackError(
                    f"the stack of {name}, called by {above[-1] if above else 'nobody'}, is not known"
                )
            below: tuple[int, list[str]] = max(
                (visit(callee, (*above, name)) for callee in graph.callees.get(name, ())), default=(0, [])
            )
            known[name] = (own + below[0], [name, *below[1]])
        return known[name]

    return visit(_resolve(graph, root), ())


def worst_case(
    graph: CallGraph, main: str, interrupts: Iterable[str], non_maskable: str, fault: str
) -> tuple[int, list[str]]:
    """Bytes of stack of the whole image, and the longest chain of calls without interrupts.

    All interrupts have one priority and so do not nest; the non-maskable one comes on top of them, and so
    does the frame of a fault, whose handler begins with an empty stack."""
    main_bytes, chain = deepest(graph, main)
    interrupt_bytes = max(deepest(graph, name)[0] for name in interrupts)
    top_bytes = deepest(graph, non_maskable)[0]
    interrupted = main_bytes + EXCEPTION_FRAME_BYTES + interrupt_bytes + EXCEPTION_FRAME_BYTES + top_bytes
    return max(interrupted, deepest(graph, fault)[0]), chain
