"""The JSON messages of version 1: who the ribbons are, and a frame."""

import json
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ribbonhost.pipeline.arrangement import Arrangement
from ribbonhost.pipeline.solving import Solved

VERSION = 1
"""Fields are only ever added within a version."""

POSITION_DIGITS = 7
ROTATION_DIGITS = 6
MOTION_DIGITS = 5


@dataclass(frozen=True)
class Facts:
    """What a listener must know before the first frame.

    Attributes:
        names, serials: of the ribbons, the reference first in a comb.
        node_counts, pitches_m: of each ribbon; 0 of one that is not there.
        start_m: where the ribbons of a comb start on the reference; empty without a comb.
        rate_hz: scans a second.
        unix_offset_s: add it to t_s for the seconds since 1970, UTC.
    """

    names: tuple[str, ...]
    serials: tuple[str, ...]
    node_counts: tuple[int, ...]
    pitches_m: tuple[float, ...]
    start_m: tuple[float, ...]
    rate_hz: int
    unix_offset_s: float

    @classmethod
    def of(cls, arrangement: Arrangement, *, rate_hz: int, unix_offset_s: float) -> "Facts":
        """Of the ribbons of a stream or a recording."""
        places, layout = arrangement.places, arrangement.layout
        nodes = layout.node_count if layout else 0
        return cls(
            names=tuple(place.label for place in places),
            serials=tuple(place.serial for place in places),
            node_counts=tuple(nodes or place.node_count for place in places),
            pitches_m=tuple(layout.pitch_m if layout else place.pitch_m for place in places),
            start_m=layout.start_m if layout else (),
            rate_hz=rate_hz,
            unix_offset_s=unix_offset_s,
        )


def hello(facts: Facts) -> str:
    """The first message."""
    return json.dumps(
        {
            "ribbons": {
                "version": VERSION,
                "rate_hz": facts.rate_hz,
                "unix_offset_s": round(facts.unix_offset_s, 6),
                "start_m": list(facts.start_m) or None,
                "ribbons": [
                    {"name": name, "serial": serial, "nodes": nodes, "pitch_m": round(pitch_m, 6)}
                    for name, serial, nodes, pitch_m in zip(
                        facts.names, facts.serials, facts.node_counts, facts.pitches_m, strict=True
                    )
                ],
            }
        },
        separators=(",", ":"),
    )


def frame(number: int, solved: Solved) -> str:
    """A frame; positions that are not known are null."""
    match = solved.match
    motion = {}
    if solved.motion:
        motion = {
            "velocity_mps": _listed(solved.motion.velocity_mps, MOTION_DIGITS),
            "acceleration_mps2": _listed(solved.motion.acceleration_mps2, MOTION_DIGITS),
        }
    return json.dumps(
        {
            "frame": {
                "number": number,
                "t_s": round(match.t_host_s, 6),
                "ribbons": list(solved.places),
                "node_m": _listed(solved.node_m, POSITION_DIGITS),
                "q_world_node": _listed(match.q_world_node, ROTATION_DIGITS),
                "valid": match.valid.astype(int).tolist(),
                "sigma_rad": _listed(match.sigma_rad, ROTATION_DIGITS),
                **motion,
            }
        },
        separators=(",", ":"),
    )


def _listed(values: NDArray[np.float64], digits: int) -> object:
    listed = np.round(values, digits).tolist()
    return listed if np.isfinite(values).all() else _without_nan(listed)


def _without_nan(value: object) -> object:
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
