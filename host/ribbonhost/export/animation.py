"""What is exported: the moving curves and surface of a comb, or of single ribbons, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ribbonhost.errors import UsageError

Array = NDArray[np.float64]
UpAxis = Literal["z", "y"]

# World (x east, y north, z up) to a frame whose y is up: x stays, north goes into the picture.
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class NodeMotion:
    """How nodes move, and how sure they are, where that was estimated; NaN elsewhere.

    velocity_mps, acceleration_mps2: (T, R, n, 3). sigma_rad: (T, R, n) standard deviation of the orientation,
    worst axis. radius_95_m: (T, R, n) around the position, holds the true one with a probability of 95 %.
    """

    velocity_mps: Array
    acceleration_mps2: Array
    sigma_rad: Array
    radius_95_m: Array


@dataclass(frozen=True)
class Animation:
    """T frames of R ribbons of n nodes, and the surface they span, in metres, ENU.

    t_s: (T,) increasing seconds from the start. node_m: (T, R, n, 3). q_world_node: (T, R, n, 4) unit,
    scalar first. valid: (T, R, n) False where an orientation was bridged. names: R names of ribbons, the
    reference first in a comb. surface_m: (T, U, W, 3) the surface as one grid, U along the ribbons, W
    across; U = W = 0 without a surface. motion: None if no motion was estimated.
    """

    t_s: Array
    node_m: Array
    q_world_node: Array
    valid: NDArray[np.bool_]
    names: tuple[str, ...]
    surface_m: NDArray[np.float32]
    motion: NodeMotion | None = None

    @property
    def has_surface(self) -> bool:
        return int(self.surface_m.shape[1]) > 1

    @property
    def rate_hz(self) -> float:
        """Mean frame rate; 0 for a single frame."""
        return (len(self.t_s) - 1) / float(self.t_s[-1] - self.t_s[0]) if len(self.t_s) > 1 else 0.0

    def between(self, start_s: float | None, end_s: float | None) -> Animation:
        """The frames from start_s to end_s inclusive. Raises UsageError if there is none."""
        low = -np.inf if start_s is None else start_s
        high = np.inf if end_s is None else end_s
        keep = (self.t_s >= low) & (self.t_s <= high)
        if not keep.any():
            raise UsageError(
                f"no frame lies between {low:g} and {high:g} s: the recording goes from "
                f"{self.t_s[0]:g} to {self.t_s[-1]:g} s"
            )
        return self._frames(np.flatnonzero(keep))

    def at_rate(self, rate_hz: float) -> Animation:
        """The nearest frames to an even clock of rate_hz; never more frames than there are."""
        if not rate_hz > 0:
            raise UsageError(f"a rate of {rate_hz:g} Hz cannot be: give a positive one")
        ticks = np.arange(self.t_s[0], self.t_s[-1] + 1e-3 / rate_hz, 1.0 / rate_hz)
        right = np.clip(np.searchsorted(self.t_s, ticks), 1, max(len(self.t_s) - 1, 1))
        if len(self.t_s) == 1:
            return self
        nearer_left = ticks - self.t_s[right - 1] < self.t_s[right] - ticks
        return self._frames(np.unique(np.where(nearer_left, right - 1, right)))

    def scaled(self, factor: float) -> Animation:
        """All lengths times `factor` (for instance 100 for centimetres)."""
        if not (np.isfinite(factor) and factor > 0):
            raise UsageError(f"a scale of {factor:g} cannot be: give a positive one")
        m = self.motion
        return replace(
            self,
            node_m=self.node_m * factor,
            surface_m=self.surface_m * np.float32(factor),
            motion=m
            and replace(
                m,
                velocity_mps=m.velocity_mps * factor,
                acceleration_mps2=m.acceleration_mps2 * factor,
                radius_95_m=m.radius_95_m * factor,
            ),
        )

    def with_up(self, up: UpAxis) -> Animation:
        """The same in a frame whose z (as it is) or y is up."""
        if up == "z":
            return self
        # A rotation by -90 degrees about x, on the left of every node's quaternion.
        c = np.sqrt(0.5)
        w, x, y, z = np.moveaxis(self.q_world_node, -1, 0)
        q = np.stack([c * (w + x), c * (x - w), c * (y + z), c * (z - y)], axis=-1)
        return replace(
            self,
            node_m=self.node_m @ Y_UP.T,
            surface_m=(self.surface_m @ Y_UP.T.astype(np.float32)),
            q_world_node=q,
            motion=self.motion
            and replace(
                self.motion,
                velocity_mps=self.motion.velocity_mps @ Y_UP.T,
                acceleration_mps2=self.motion.acceleration_mps2 @ Y_UP.T,
            ),
        )

    def _frames(self, index: NDArray[np.intp]) -> Animation:
        return replace(
            self,
            t_s=self.t_s[index],
            node_m=self.node_m[index],
            q_world_node=self.q_world_node[index],
            valid=self.valid[index],
            surface_m=self.surface_m[index],
            motion=self.motion
            and NodeMotion(**{f.name: getattr(self.motion, f.name)[index] for f in fields(NodeMotion)}),
        )


def surface_grid(vertices_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Patches (..., R - 1, n - 1, V, V, 3), third index along the ribbon, as one grid (..., U, W, 3).

    U = (n - 1) (V - 1) + 1 along the ribbons, W = (R - 1) (V - 1) + 1 across; shared borders once.
    """
    *frames, r, n, v, _, _ = vertices_m.shape
    # (..., patch along, inner along, patch across, inner across, 3) without each patch's last row and column.
    order = (*range(len(frames)), *(len(frames) + axis for axis in (1, 2, 0, 3, 4)))
    p = np.transpose(vertices_m, order)
    grid = np.empty((*frames, n * (v - 1) + 1, r * (v - 1) + 1, 3), np.float32)
    grid[..., :-1, :-1, :] = p[..., :-1, :, :-1, :].reshape(*frames, n * (v - 1), r * (v - 1), 3)
    grid[..., -1, :-1, :] = p[..., -1, -1, :, :-1, :].reshape(*frames, r * (v - 1), 3)
    grid[..., :-1, -1, :] = p[..., :, :-1, -1, -1, :].reshape(*frames, n * (v - 1), 3)
    grid[..., -1, -1, :] = p[..., -1, -1, -1, -1, :]
    return grid


def grid_triangles(u: int, w: int) -> NDArray[np.uint32]:
    """Triangles (2 (u - 1) (w - 1), 3) of a grid of u x w vertices, counter-clockwise seen from along x
    across.
    """
    corner = (np.arange(u - 1)[:, None] * w + np.arange(w - 1)).ravel()
    a, b, c, d = corner, corner + 1, corner + w + 1, corner + w
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.uint32)


def grid_normals(surface_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit normals (T, U, W, 3) of grids (T, U, W, 3), by central differences, on the side of across x
    along.
    """
    along = np.gradient(surface_m, axis=1)
    across = np.gradient(surface_m, axis=2)
    normal = np.cross(across, along)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return (normal / np.where(length > 0, length, 1.0)).astype(np.float32)
