"""Which ribbons a view shows: all their nodes in one row, and what makes positions of orientations."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ribbonhost.pipeline.arrangement import Arrangement
from ribbonhost.pipeline.solving import Solved
from ribbonhost.reconstruct import CombFrame, CombLayout, CombSolver, RibbonSolver, bridge, node_arc_lengths
from ribbonhost.reconstruct.comb import Method

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

GAP_M = 0.15
"""Ribbons that belong to no comb are shown so far apart, side by side."""


@dataclass(frozen=True)
class Layout:
    """The ribbons of a stream; N is the number of all their nodes.

    labels: of each ribbon. node_counts, pitch_m: of each. comb: where they start; None if they make no comb.
    """

    labels: tuple[str, ...]
    node_counts: tuple[int, ...]
    pitch_m: tuple[float, ...]
    comb: CombLayout | None

    @property
    def node_count(self) -> int:
        """N."""
        return sum(self.node_counts)

    @property
    def slices(self) -> list[slice]:
        """The nodes of each ribbon in the row."""
        ends = np.cumsum(self.node_counts).tolist()
        return [slice(end - count, end) for end, count in zip(ends, self.node_counts, strict=True)]

    @property
    def node_ribbon(self) -> NDArray[np.int64]:
        """(N,) the ribbon of each node."""
        return np.repeat(np.arange(len(self.node_counts)), self.node_counts)

    @property
    def node_s_m(self) -> list[Float64]:
        """(n,) arc lengths of the nodes of each ribbon from its anchor."""
        return [node_arc_lengths(p, n) for p, n in zip(self.pitch_m, self.node_counts, strict=True)]

    @property
    def length_m(self) -> float:
        """Of the longest ribbon."""
        return max((2 * n - 1) * p for p, n in zip(self.pitch_m, self.node_counts, strict=True))

    @property
    def origin_m(self) -> Float64:
        """(ribbons, 3) where ribbons without a comb are shown; 0 in a comb."""
        origin = np.zeros((len(self.labels), 3))
        if self.comb is None:
            origin[:, 0] = GAP_M * np.arange(len(self.labels))
        return origin


def layout_of(arrangement: Arrangement) -> Layout:
    """The layout of the ribbons of a stream; one that is missing in a comb is like its neighbours."""
    places = arrangement.places
    if comb := arrangement.layout:
        counts, pitches = (comb.node_count,) * len(places), (comb.pitch_m,) * len(places)
    else:
        counts = tuple(place.node_count for place in places)
        pitches = tuple(place.pitch_m for place in places)
    return Layout(tuple(place.label for place in places), counts, pitches, comb)


@dataclass(frozen=True)
class Moment:
    """All nodes at one moment.

    t_s: when. q_world_node: (N, 4) unit. known: (N,) which of them mean something; valid: (N,) as the
    devices said. sigma_rad: (N,) of the orientations, NaN where not known. quality: (N,) as on the wire.
    node_m: (N, 3) metres, as shown. anchor_m: (ribbons, 3). truth_m: (N, 3), None where it is not known.
    comb: the whole frame of a comb. parts: the results that it was made of; none if it was kept.
    """

    t_s: float
    q_world_node: Float64
    known: Bool
    valid: Bool
    sigma_rad: Float64
    quality: NDArray[np.uint8]
    node_m: Float64
    anchor_m: Float64
    truth_m: Float64 | None = None
    comb: CombFrame | None = None
    parts: tuple[Solved, ...] = ()

    def there(self, layout: Layout) -> Bool:
        """(N,) nodes of ribbons of which any node is known."""
        return np.concatenate([np.full(n, self.known[at].any()) for at, n in _ribbons(layout)])

    def bridged(self, layout: Layout) -> Float64:
        """(N, 4) orientations with those of unknown nodes from their neighbours."""
        if self.known.all():
            return self.q_world_node
        q = self.q_world_node.copy()
        for at, s_m in zip(layout.slices, layout.node_s_m, strict=True):
            if not self.known[at].any():
                q[at] = (1.0, 0.0, 0.0, 0.0)
            elif not self.known[at].all():
                q[at] = bridge(s_m, q[at], self.known[at]).q_world_node
        return q


def _ribbons(layout: Layout) -> Iterator[tuple[slice, int]]:
    return zip(layout.slices, layout.node_counts, strict=True)


class Solver:
    """Makes moments of orientations that were kept, as the stream did."""

    def __init__(self, layout: Layout, method: Method) -> None:
        self._layout = layout
        self._comb = CombSolver(layout.comb, method) if layout.comb else None
        self._ribbons: Sequence[RibbonSolver] = (
            []
            if layout.comb
            else [RibbonSolver(p, n, method) for p, n in zip(layout.pitch_m, layout.node_counts, strict=True)]
        )

    def solve(
        self,
        t_s: float,
        q_world_node: Float64,
        known: Bool,
        valid: Bool,
        sigma_rad: Float64,
        quality: NDArray[np.uint8],
    ) -> Moment:
        """The moment of these, see there; positions of ribbons of which nothing is known are NaN."""
        layout = self._layout
        if self._comb:
            shape = (len(layout.labels), layout.node_counts[0])
            frame = self._comb.solve(q_world_node.reshape(*shape, 4), known.reshape(shape))
            node_m, anchor_m = frame.node_m.reshape(-1, 3), frame.anchor_m
            return Moment(t_s, q_world_node, known, valid, sigma_rad, quality, node_m, anchor_m, comb=frame)
        node_m = np.full((layout.node_count, 3), np.nan)
        origins = layout.origin_m
        for solver, nodes, origin in zip(self._ribbons, layout.slices, origins, strict=True):
            if known[nodes].any():
                node_m[nodes] = origin + solver.solve(q_world_node[nodes], known[nodes])
        return Moment(t_s, q_world_node, known, valid, sigma_rad, quality, node_m, origins)
