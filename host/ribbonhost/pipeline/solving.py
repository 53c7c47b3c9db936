"""What becomes of matched scans: the surface of a comb, or the curve of a ribbon that belongs to none."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ribbonhost.motion.anchor import start_weights
from ribbonhost.pipeline.matching import Match, Matcher
from ribbonhost.pipeline.poses import PoseSource
from ribbonhost.pipeline.tally import Tally
from ribbonhost.reconstruct import CombFrame, CombLayout, CombSolver, error_percent
from ribbonhost.reconstruct.comb import Method
from ribbonhost.reconstruct.ribbon import RibbonSolver

Truth = Callable[[float], NDArray[np.float64]]
"""Positions (R + 1, n, 3) of all nodes at a host time, metres, as in CombFrame.node_m."""


Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class SolvedMotion:
    """How the nodes move, in the frame of Solved.node_m; NaN of ribbons that are not estimated.

    velocity_mps, acceleration_mps2: (r, n, 3). position_covariance_m2: (r, n, 3, 3).
    """

    velocity_mps: Float64
    acceleration_mps2: Float64
    position_covariance_m2: Float64


@dataclass(frozen=True)
class Solved:
    """A reconstructed moment.

    Attributes:
        match: the orientations that it was made of.
        places: indices of its ribbons among all, in the order of the arrays.
        node_m: (r, n, 3) positions of the nodes, metres; of a comb from the reference's anchor.
        comb: the whole frame; None of a single ribbon.
        truth_m: where the nodes truly are, as node_m; None where that is not known.
        starts: (r - 1, n) weights of the reference's nodes where the ribbons of a comb start on it.
    """

    match: Match
    places: tuple[int, ...]
    node_m: NDArray[np.float64]
    comb: CombFrame | None
    truth_m: NDArray[np.float64] | None = None
    starts: NDArray[np.float64] | None = None

    @cached_property
    def motion(self) -> SolvedMotion | None:
        """How the nodes move; None if no ribbon is estimated. In a comb the reference carries the others."""
        if not any(self.match.moving):
            return None
        shape = self.match.q_world_node.shape[1]
        arrays = []
        for name, axes in (("velocity_mps", 1), ("acceleration_mps2", 1), ("position_covariance_m2", 2)):
            own = np.stack(
                [
                    getattr(moving, name) if moving else np.full((shape, *(3,) * axes), np.nan)
                    for moving in self.match.moving
                ]
            )
            if self.starts is not None:
                own[1:] += np.tensordot(self.starts, own[0], 1)[:, None]
            arrays.append(own)
        return SolvedMotion(*arrays)


OnSolved = Callable[[Solved], None]
"""Who wants each frame: a view, a file, a port. Called in the thread that reconstructs; must be quick."""


class CombTask:
    """Makes a surface of each match of a whole comb.

    Attributes:
        places: indices of its ribbons among all, the reference first.
        frame: the newest; None before the first.
    """

    def __init__(
        self,
        layout: CombLayout,
        rate_hz: int,
        method: Method,
        truth: Truth | None,
        source: PoseSource | None = None,
    ) -> None:
        """source: makes poses of scans; None: orientations as the devices say them."""
        self.places = tuple(range(len(layout.start_m) + 1))
        self.matcher = Matcher(len(self.places), layout.node_count, 1 / rate_hz, source)
        self._starts = start_weights(layout.node_count, layout.pitch_m, layout.start_m)
        self.frame: CombFrame | None = None
        self._solver = CombSolver(layout, method)
        self._truth = truth
        self._length_m = layout.length_m

    def solve(self, match: Match, tally: Tally) -> Solved | None:
        """Reconstructs a match and counts it; None if that is not possible."""
        try:
            frame = self._solver.solve(match.q_world_node, match.known)
        except ValueError:
            tally.unsolved += 1
            return None
        tally.add_frame(match.t_host_s, match.scans)
        tally.lambda_limited += frame.lambda_limited
        self.frame = frame
        there = frame.ribbon_valid[1:]
        truth_m = self._truth(match.t_host_s) if self._truth else None
        if frame.ribbon_valid[0] and np.count_nonzero(there) >= 2:
            tally.surfaces += 1
            if truth_m is not None:
                tally.add_error(error_percent(frame.node_m[1:][there], truth_m[1:][there], self._length_m))
        return Solved(match, self.places, frame.node_m, frame, truth_m, self._starts)


class CurveTask:
    """Makes a curve of each scan of one ribbon.

    Attributes:
        places: its index among all.
        node_m: (n, 3) the newest curve, metres, from its own anchor; None before the first.
    """

    def __init__(
        self,
        place: int,
        pitch_m: float,
        node_count: int,
        rate_hz: int,
        method: Method,
        source: PoseSource | None = None,
    ) -> None:
        """source: as for CombTask."""
        self.places = (place,)
        self.matcher = Matcher(1, node_count, 1 / rate_hz, source)
        self.node_m: NDArray[np.float64] | None = None
        self._solver = RibbonSolver(pitch_m, node_count, method)

    def solve(self, match: Match, tally: Tally) -> Solved | None:
        """Reconstructs a scan and counts it; None if that is not possible."""
        try:
            self.node_m = self._solver.solve(match.q_world_node[0], match.known[0])
        except ValueError:
            tally.unsolved += 1
            return None
        tally.add_frame(match.t_host_s, {self.places[i]: scan for i, scan in match.scans.items()})
        return Solved(match, self.places, self.node_m[None], None)
