"""One ribbon from the orientations of its nodes: bridging of invalid ones, its curve; many frames at once."""

from dataclasses import dataclass

import numpy as np

from ribbonhost.native._native import ffi, lib
from ribbonhost.reconstruct import arguments
from ribbonhost.reconstruct.arguments import Bool, Float64, doubles
from ribbonhost.reconstruct.curve import Method, curve_points


@dataclass(frozen=True)
class Orientations:
    """Orientations of all nodes of a ribbon, invalid ones filled from the valid.

    q_world_node: (..., n, 4) unit, scalar first. bridged: (..., n) which of them were filled.
    spread_rad: (..., n) a cautious measure of the error of the filling, 0 where there is none: how far
    a simpler filling lies away.
    """

    q_world_node: Float64
    bridged: Bool
    spread_rad: Float64

    @property
    def tangent(self) -> Float64:
        """(..., n, 3) unit vectors along the ribbon, toward growing s."""
        return self._directions()[0]

    @property
    def binormal(self) -> Float64:
        """(..., n, 3) unit vectors across the ribbon, in its plane."""
        return self._directions()[1]

    def _directions(self) -> tuple[Float64, Float64]:
        shape = (*self.q_world_node.shape[:-1], 3)
        tangent, binormal = np.empty(shape), np.empty(shape)
        lib.ribbon_directions(
            tangent.size // 3, doubles(self.q_world_node), doubles(tangent), doubles(binormal)
        )
        return tangent, binormal


def bridge(node_s_m: Float64, q_world_node: Float64, valid: Bool | None = None) -> Orientations:
    """Fills the orientations of invalid nodes by cubic interpolation from the four nearest valid ones.

    node_s_m: (n,) arc lengths. q_world_node: (..., n, 4) unit, scalar first, world from node; not read
    where `valid` (..., n) is False (None: all valid). Beyond the outermost valid node: linear over at
    most the distance of the outermost two, then constant. Raises TypeError or ValueError naming the
    argument; ValueError also for a ribbon without a valid node.
    """
    node_s_m = arguments.arc_lengths("node_s_m", node_s_m)
    n = len(node_s_m)
    q_world_node = arguments.floats("q_world_node", q_world_node, "...", n, 4)
    leading = q_world_node.shape[:-1]
    valid = np.ones(leading, np.bool_) if valid is None else arguments.flags("valid", valid, *leading)
    if not valid.any(axis=-1).all():
        raise ValueError("valid marks no node of a ribbon as valid")
    bridged, spread = np.empty_like(q_world_node), np.empty(leading)
    code = lib.ribbon_bridge(
        valid.size // n,
        n,
        doubles(node_s_m),
        doubles(q_world_node),
        ffi.from_buffer("uint8_t[]", valid),
        doubles(bridged),
        doubles(spread),
    )
    arguments.raise_for(
        code, {lib.RIBBON_ERROR_NOT_FINITE: "q_world_node", lib.RIBBON_ERROR_NOT_UNIT: "q_world_node"}
    )
    return Orientations(bridged, ~valid, spread)


def node_arc_lengths(pitch_m: float, node_count: int) -> Float64:
    """(n,) arc lengths (2k + 1) pitch_m of the nodes of a ribbon, metres from its anchor."""
    return np.arange(1, 2 * node_count, 2, dtype=np.float64) * pitch_m


class RibbonSolver:
    """Reconstructs the curve of one ribbon, for ribbons that belong to no comb.

    pitch_m: distance between neighbouring sensors. node_count: nodes n; node k sits (2k + 1) pitch_m from the
    anchor. method: as for curve_points.
    """

    def __init__(self, pitch_m: float, node_count: int, method: Method = "spline") -> None:
        self.node_s_m = node_arc_lengths(pitch_m, node_count)
        self._method: Method = method

    def solve(self, q_world_node: Float64, valid: Bool | None = None) -> Float64:
        """Positions (..., n, 3) of the nodes, metres, world axes, the anchor at the origin; see bridge."""
        orientations = bridge(self.node_s_m, q_world_node, valid)
        return curve_points(self.node_s_m, orientations.tangent, method=self._method)
