"""What came from a device, counted: nothing is dropped in silence."""

from dataclasses import dataclass, fields


@dataclass(frozen=True)
class Counters:
    """What came from a device since its link was opened; the difference of two is what came in between.

    Attributes:
        frames: ORIENT frames that were used.
        lost: scans whose frames never came, by the gaps in the sequence.
        invalid_nodes: nodes without an orientation in the frames used.
        crc_errors: frames with a wrong checksum.
        malformed: frames that are no COBS or no possible length, and packets shorter than their fields.
        unknown_packets: packets of a type that this host does not know, or that only a host sends.
        surplus_bytes: bytes after the last known field, from a device with a later schema.
        wrong_node_count: ORIENT frames with another number of nodes than INFO says. Not used.
        sequence_jumps: ORIENT frames whose sequence skips more scans than there was time for.
        clock_jumps: ORIENT frames and answered pings whose device time cannot be. Not used.
        repeated: ORIENT frames with the sequence of the one before. Not used.
        untimed: ORIENT frames that came while the device's clock was not known. Not used.
        raw_lost: scans that are used without their RAW, which was to come beside ORIENT.
        unexpected: answers to no question: an ACK or CLOCK_PONG with an unknown tag.
    """

    frames: int = 0
    lost: int = 0
    invalid_nodes: int = 0
    crc_errors: int = 0
    malformed: int = 0
    unknown_packets: int = 0
    surplus_bytes: int = 0
    wrong_node_count: int = 0
    sequence_jumps: int = 0
    clock_jumps: int = 0
    repeated: int = 0
    untimed: int = 0
    raw_lost: int = 0
    unexpected: int = 0

    def __sub__(self, earlier: "Counters") -> "Counters":
        return Counters(*(getattr(self, f.name) - getattr(earlier, f.name) for f in fields(self)))


class Counts:
    """Counters while they count; written by one thread."""

    def __init__(self) -> None:
        self._values = dict.fromkeys((f.name for f in fields(Counters)), 0)

    def add(self, name: str, count: int = 1) -> None:
        """Adds to one of the Counters."""
        self._values[name] += count

    def read(self) -> Counters:
        """As they are now."""
        return Counters(**self._values)
