"""Frames for other programs while they are made: JSON lines, WebSocket, TCP, OSC, Lab Streaming Layer.

A target is one of

    ndjson             JSON lines on stdout
    ws://HOST:PORT     the same, a WebSocket message each, for any number of listeners
    tcp://HOST:PORT    the same as lines, for any number of listeners
    osc://HOST:PORT    Open Sound Control, sent to this address by UDP
    lsl                a Lab Streaming Layer outlet, on this machine; lsl://network: for the local network

docs/live-out.md has the layout of the messages.
"""

from collections.abc import Callable

from ribbonhost.errors import UsageError
from ribbonhost.out.address import split_target
from ribbonhost.out.feed import Feed
from ribbonhost.out.message import Facts

__all__ = ["Facts", "Feed", "open_feed"]


def open_feed(target: str, facts: Facts, write_line: Callable[[str], None]) -> Feed:
    """Opens a target, which then may be told frames. write_line: takes the lines for stdout.

    Raises UsageError for what is no target, RibbonError if a port cannot be had, MissingExtraError without
    the library.
    """
    kind, host, port = split_target(target)
    match kind:
        case "ndjson":
            from ribbonhost.out.lines import LineFeed

            return LineFeed(facts, write_line)
        case "ws" | "tcp":
            from ribbonhost.out.server import ServerFeed

            return ServerFeed(target, kind, host, port, facts)
        case "osc":
            from ribbonhost.out.osc import OscFeed

            return OscFeed(target, host, port, facts)
        case "lsl":
            from ribbonhost.out.lsl import LslFeed

            return LslFeed(target, facts, on_network=host == "network")
    raise UsageError(f"--out {target}: there is no such kind of target")
