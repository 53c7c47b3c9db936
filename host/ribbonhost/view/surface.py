"""The surface of a comb as a grid, smooth or of the nodes alone, cut into bands of one colour."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ribbonhost.export.animation import grid_triangles, surface_grid
from ribbonhost.view.contours import Cut, Cutter
from ribbonhost.view.layout import Float64, Layout, Moment
from ribbonhost.view.shading import BANDS, Quantity, Scale

Float32 = NDArray[np.float32]
Kind = Literal["smooth", "nodes"]

PATCH_VERTICES = 8
"""Along one side of a patch, as the stream has them."""

KEPT_ALONG = (0, 2, 5)
"""Of the rows along a patch's seven steps, those that are drawn: nodes are closer together than ribbons."""


@dataclass(frozen=True)
class _Grid:
    """One way to draw the surface: (U, W) vertices, and how values at nodes (n, R) spread over them."""

    shape: tuple[int, int]
    cutter: Cutter
    along: Float64
    across: Float64

    def spread(self, at_nodes: Float64) -> Float64:
        """(U, W) values between those at nodes (n, R); NaN next to a node without a value."""
        known = np.isfinite(at_nodes)
        values = self.along @ np.where(known, at_nodes, 0.0) @ self.across
        whole = self.along @ known @ self.across > 1 - 1e-9
        return np.where(whole, values, np.nan)


class Surface:
    """The surface of moments of one comb."""

    def __init__(self, layout: Layout) -> None:
        assert layout.comb is not None
        self._layout = layout
        ribbons, nodes = len(layout.comb.start_m), layout.comb.node_count
        patches = (ribbons - 1, nodes - 1, PATCH_VERTICES, PATCH_VERTICES)
        count = int(np.prod(patches))
        # The grid of vertex numbers says which vertex of a patch each of the grid is.
        numbers = np.repeat(np.arange(count, dtype=np.float32).reshape(*patches, 1), 3, axis=-1)
        rows = (nodes - 1) * (PATCH_VERTICES - 1) + 1
        kept = np.isin(np.arange(rows) % (PATCH_VERTICES - 1), KEPT_ALONG)
        self._place = surface_grid(numbers)[kept, :, 0].astype(np.int64)
        self._grids = {
            "smooth": _grid(_between(nodes)[kept], _between(ribbons).T),
            "nodes": _grid(np.eye(nodes), np.eye(ribbons)),
        }

    def vertices(self, moment: Moment, kind: Kind) -> Float32:
        """(U, W, 3) metres, U along the ribbons; NaN where there is no surface."""
        frame = moment.comb
        assert frame is not None
        if kind == "nodes":
            return np.swapaxes(frame.node_m[1:], 0, 1).astype(np.float32)
        return frame.vertices_m.reshape(-1, 3)[self._place]

    def cut(self, moment: Moment, kind: Kind, scale: Scale | None) -> Cut:
        """The bands of a scale, and one of all that is there without a value."""
        grid = self._grids[kind]
        points = self.vertices(moment, kind)
        there = np.isfinite(points[..., 0])
        levels = np.full(there.shape, np.nan)
        if scale:
            levels = scale.levels(self._values(scale.quantity, moment, kind))
        return grid.cutter.cut(levels.ravel(), there.ravel(), BANDS)

    def _values(self, quantity: Quantity, moment: Moment, kind: Kind) -> Float64:
        ribbons = len(self._layout.labels)
        at_nodes = quantity.of_nodes(self._layout, moment).reshape(ribbons, -1)[1:].T
        return self._grids[kind].spread(at_nodes)


def _grid(along: Float64, across: Float64) -> _Grid:
    shape = len(along), across.shape[1]
    return _Grid(shape, Cutter(grid_triangles(*shape)), along, across)


def _between(count: int) -> Float64:
    """((count - 1) (V - 1) + 1, count) linear interpolation between so many knots."""
    u = np.arange((count - 1) * (PATCH_VERTICES - 1) + 1) / (PATCH_VERTICES - 1)
    return np.maximum(0.0, 1.0 - np.abs(u[:, None] - np.arange(count)))
