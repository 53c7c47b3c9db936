"""Open Sound Control by UDP: one message a ribbon and frame, laid out once and filled by NumPy.

OSC 1.0: an address and the type tags, each padded to 4 bytes with zeros, then the arguments, big endian.
"""

import socket
import struct

import numpy as np

from ribbonhost.errors import RibbonError
from ribbonhost.out.feed import Feed
from ribbonhost.out.message import VERSION, Facts
from ribbonhost.pipeline.solving import Solved


class OscFeed(Feed):
    """Sends to one address, whether or not somebody listens: UDP does not tell."""

    def __init__(self, target: str, host: str, port: int, facts: Facts) -> None:
        """Raises RibbonError for a host that is not known."""
        super().__init__(target)
        try:
            family, kind, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        except OSError as error:
            raise RibbonError(f"--out {target}: {host} is not known: {error.strerror}") from error
        self._address = address
        self._socket = socket.socket(family, kind)
        # Whoever sends must not wait: what the system does not take at once is missed.
        self._socket.setblocking(False)
        self._facts = facts
        self._heads = [
            _head(f"/ribbon/{index}", "iidii" + "f" * (7 * nodes))
            for index, nodes in enumerate(facts.node_counts)
        ]

    def _send(self, number: int, solved: Solved) -> None:
        match = solved.match
        values = np.concatenate([solved.node_m, match.q_world_node], axis=-1).astype(">f4")
        for row, place in enumerate(solved.places):
            invalid = int((~match.valid[row]).sum())
            fixed = struct.pack(
                ">iidii", VERSION, number % (1 << 31), match.t_host_s, values.shape[1], invalid
            )
            try:
                self._socket.sendto(self._heads[place] + fixed + values[row].tobytes(), self._address)
            except OSError:
                self._missed += 1

    def _end(self) -> None:
        self._socket.close()


def _head(address: str, tags: str) -> bytes:
    return _padded(address) + _padded("," + tags)


def _padded(text: str) -> bytes:
    data = text.encode() + b"\0"
    return data + bytes(-len(data) % 4)
