"""Recordings: all that ribbons sent, kept as it came, in MCAP files that survive what ends their writing."""

from ribbonhost.record.finalise import Decoded, finalise
from ribbonhost.record.layout import Header, RecordedRibbon
from ribbonhost.record.reader import (
    Back,
    Event,
    Item,
    Lost,
    Received,
    Recording,
    Sent,
    Spoiled,
    is_complete,
)
from ribbonhost.record.recorder import Recorder
from ribbonhost.record.recover import Recovered, recover
from ribbonhost.record.tape import Tape

__all__ = [
    "Back",
    "Decoded",
    "Event",
    "Header",
    "Item",
    "Lost",
    "Received",
    "RecordedRibbon",
    "Recorder",
    "Recording",
    "Recovered",
    "Sent",
    "Spoiled",
    "Tape",
    "finalise",
    "is_complete",
    "recover",
]
