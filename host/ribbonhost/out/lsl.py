"""A Lab Streaming Layer outlet for each ribbon: seven channels a node."""

import time

import numpy as np

from ribbonhost.errors import MissingExtraError
from ribbonhost.out.feed import Feed
from ribbonhost.out.message import VERSION, Facts
from ribbonhost.pipeline.solving import Solved

COLUMNS = (
    ("x", "metres"), ("y", "metres"), ("z", "metres"), ("qw", "1"), ("qx", "1"), ("qy", "1"), ("qz", "1"),
)  # fmt: skip
QUIET = "[log]\nlevel = -1\n"
ON_THIS_MACHINE = "[multicast]\nResolveScope = machine\nListenAddress = 127.0.0.1\n[ports]\nIPv6 = disable\n"


class LslFeed(Feed):
    """Samples are float32, NaN where a node is not known; their time stamps are the moments of the scans."""

    def __init__(self, target: str, facts: Facts, *, on_network: bool) -> None:
        """Raises MissingExtraError without pylsl."""
        super().__init__(target)
        try:
            import pylsl
        # RuntimeError: the Python part is there, the library that it loads is not.
        except (ImportError, RuntimeError) as error:
            raise MissingExtraError("--out lsl", "pylsl", "out") from error
        pylsl.set_config_content(QUIET + ("" if on_network else ON_THIS_MACHINE))
        self.note = "Lab Streaming Layer listens at all network addresses of this machine"
        if not on_network:
            self.note += (
                ": it has no setting against it, a firewall has; its streams are announced "
                "on this machine only (lsl://network: on the network)"
            )
        # Both clocks are steady; on most systems they are the same.
        self._offset_s = pylsl.local_clock() - time.monotonic()
        self._outlets = [
            pylsl.StreamOutlet(_info(pylsl, facts, index)) if nodes else None
            for index, nodes in enumerate(facts.node_counts)
        ]

    def _send(self, number: int, solved: Solved) -> None:
        match = solved.match
        values = np.concatenate([solved.node_m, match.q_world_node], axis=-1).astype(np.float32)
        t_lsl_s = match.t_host_s + self._offset_s
        for row, place in enumerate(solved.places):
            if outlet := self._outlets[place]:
                outlet.push_sample(values[row].ravel(), t_lsl_s)

    def _end(self) -> None:
        self._outlets.clear()


def _info(pylsl: object, facts: Facts, index: int) -> object:
    nodes = facts.node_counts[index]
    info = pylsl.StreamInfo(  # type: ignore[attr-defined]
        f"ribbon {facts.names[index]}", "MoCap", 7 * nodes, facts.rate_hz, "float32", facts.serials[index]
    )
    about = info.desc()
    for key, value in (
        ("layout_version", VERSION),
        ("serial", facts.serials[index]),
        ("name", facts.names[index]),
        ("pitch_m", facts.pitches_m[index]),
        ("frame", "east, north, up"),
    ):
        about.append_child_value(key, str(value))
    channels = about.append_child("channels")
    for node in range(nodes):
        for name, unit in COLUMNS:
            channel = channels.append_child("channel")
            channel.append_child_value("label", f"node{node}_{name}")
            channel.append_child_value("unit", unit)
            channel.append_child_value("type", "Position" if unit == "metres" else "Orientation")
    return info
