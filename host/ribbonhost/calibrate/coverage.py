"""Which attitudes of a bar are done, which are missing, and what to do next, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ribbonhost.calibrate.sensor_errors import Array, Poses

SIDES: tuple[tuple[str, Array], ...] = (
    ("sensor side", np.array([0.0, 0.0, 1.0])),
    ("back", np.array([0.0, 0.0, -1.0])),
    ("left edge", np.array([0.0, 1.0, 0.0])),
    ("right edge", np.array([0.0, -1.0, 0.0])),
    ("far end", np.array([1.0, 0.0, 0.0])),
    ("connector end", np.array([-1.0, 0.0, 0.0])),
)
"""What can be up, seen with the connector toward oneself and the sensors on top, as a node's axis."""
WANTED = 4
"""Headings for each side."""
APART_RAD = np.radians(50.0)
"""Two headings that are nearer count as one."""
OPPOSITE_RAD = np.radians(130.0)
TABLE = 4


@dataclass(frozen=True)
class Coverage:
    """What has been done.

    headings: for each of SIDES, headings that it was up with, up to WANTED. on_table: of the four poses in
    which the bar lies on a table. poses: in all.
    """

    headings: tuple[int, ...]
    on_table: tuple[bool, bool, bool, bool]
    poses: int

    @property
    def complete(self) -> bool:
        """Whether nothing is missing."""
        return all(self.on_table) and min(self.headings) >= WANTED

    @property
    def share(self) -> float:
        """How much is done, 0 to 1."""
        return (sum(self.headings) + sum(self.on_table)) / (WANTED * len(SIDES) + TABLE)

    @property
    def next_step(self) -> str:
        """What to do now."""
        for done, what in zip(self.on_table, _ON_TABLE, strict=True):
            if not done:
                return what
        side = int(np.argmin(self.headings))
        if self.headings[side] >= WANTED:
            return "All attitudes are done."
        name = SIDES[side][0]
        if self.headings[side] == 0:
            return f"Hold the bar with its {name} up, still for two seconds."
        return f"Keep the {name} up, turn the bar a quarter turn about the vertical, and hold it still."


_ON_TABLE = (
    "Lay the bar on a table, away from steel, with its sensor side up.",
    "Turn it end for end on the table, the sensor side still up.",
    "Lay it on its right edge, so that its left edge is up.",
    "Turn it end for end on the table, the left edge still up.",
)


def side_up(up_bar: Array) -> int:
    """Which of SIDES is up most; up_bar (3,)."""
    return int(np.argmax([axis @ up_bar for _, axis in SIDES]))


def coverage_of(poses: Poses, field_ut: Array) -> Coverage:
    """What poses cover, told by sensors without calibration.

    field_ut: (P, 3) mean of the magnetometers; their z may be zero where it is not measured.
    """
    headings: list[list[float]] = [[] for _ in SIDES]
    lying: dict[int, list[float]] = {}
    for p in range(len(poses)):
        up = poses.accel_mps2[p].mean(axis=0)
        up = up / np.linalg.norm(up)
        side = side_up(up)
        heading = _heading(up, SIDES[side][1], field_ut[p])
        if all(_between(heading, other) > APART_RAD for other in headings[side]):
            headings[side].append(heading)
        if np.any(poses.up_face[p]):
            lying.setdefault(side, []).append(heading)
    on_table = []
    for pair in ((0, 1), (2, 3)):
        best = max((_done(lying.get(side, [])) for side in pair), default=0)
        on_table += [best >= 1, best >= 2]
    return Coverage(
        tuple(min(len(found), WANTED) for found in headings),
        (on_table[0], on_table[1], on_table[2], on_table[3]),
        len(poses),
    )


def _done(headings: list[float]) -> int:
    """1: the bar lay so. 2: also turned end for end."""
    turned = any(_between(a, b) > OPPOSITE_RAD for a in headings for b in headings)
    return 2 if turned else min(len(headings), 1)


def _heading(up: Array, side: Array, field_ut: Array) -> float:
    """Where north is around the side that is up, from an axis of the bar that is level."""
    level = field_ut - (field_ut @ up) * up
    first = np.roll(side, 1) - (np.roll(side, 1) @ up) * up
    return float(np.arctan2(np.cross(first, level) @ up, first @ level))


def _between(a: float, b: float) -> float:
    return abs((a - b + np.pi) % (2 * np.pi) - np.pi)
