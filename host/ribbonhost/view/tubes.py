"""The bodies of ribbons: flat tubes along their curves, and round ones of any radius around them."""

import numpy as np
from numpy.typing import NDArray

from ribbonhost.reconstruct.surface import hermite_basis
from ribbonhost.view.layout import Bool, Float64, Layout, Moment

Float32 = NDArray[np.float32]

WIDTH_M, THICKNESS_M = 0.010, 0.004
"""Of the ribbons as drawn."""

STEPS = 3
"""Points of a curve between two nodes."""
SIDES = 8


def axes_of(q: Float64) -> tuple[Float64, Float64, Float64]:
    """Tangent, binormal and normal (N, 3) of nodes (N, 4)."""
    w, x, y, z = q.T
    tangent = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], -1)
    binormal = np.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], -1)
    return tangent, binormal, np.cross(tangent, binormal)


class Tubes:
    """Rings of SIDES vertices around points of the curves of all ribbons.

    All that a curve point takes from its neighbouring nodes is linear: one matrix for positions, one for
    tangents, one for what is interpolated straight.
    """

    def __init__(self, layout: Layout) -> None:
        positions, slopes, straight, faces, owner = [], [], [], [], []
        begun = 0
        nodes, ribbons = layout.node_count, len(layout.labels)
        for ribbon, (at, s_m) in enumerate(zip(layout.slices, layout.node_s_m, strict=True)):
            knots = np.concatenate([[0.0], s_m])
            # Columns: the anchors of all ribbons, then all nodes. An anchor is directed as the first node.
            column = np.concatenate([[ribbon], ribbons + np.arange(at.start, at.stop)])
            turn = np.concatenate([[at.start], np.arange(at.start, at.stop)])
            u = np.arange(STEPS) / STEPS
            basis = hermite_basis(u)
            for k in range(len(s_m)):
                last = k == len(s_m) - 1
                share = np.append(u, 1.0) if last else u
                along = hermite_basis(share) if last else basis
                p, d, i = (np.zeros((len(share), width)) for width in (ribbons + nodes, nodes, nodes))
                ds = knots[k + 1] - knots[k]
                p[:, column[k]] += along[0]
                p[:, column[k + 1]] += along[1]
                d[:, turn[k]] += ds * along[2]
                d[:, turn[k + 1]] += ds * along[3]
                i[:, turn[k]] += 1 - share
                i[:, turn[k + 1]] += share
                positions.append(p)
                slopes.append(d)
                straight.append(i)
                # Half of a segment belongs to each of its nodes.
                near = np.where(share[:STEPS] < 0.5, turn[k], turn[k + 1])
                owner.append(near)
            rings = STEPS * len(s_m) + 1
            faces.append(begun * SIDES + _tube_faces(rings))
            begun += rings
        self._position, self._slope = np.concatenate(positions), np.concatenate(slopes)
        self._straight = np.concatenate(straight)
        self._faces = np.concatenate(faces).astype(np.uint32)
        self._face_node = np.repeat(np.concatenate(owner), 2 * SIDES)
        angle = 2 * np.pi * np.arange(SIDES) / SIDES
        self._cos, self._sin = np.cos(angle)[:, None], np.sin(angle)[:, None]

    def rings(self, moment: Moment, q_world_node: Float64, radius_m: Float64 | None = None) -> Float32:
        """(V, 3) vertices: flat tubes, or round ones of the radius (N,) around each node.

        q_world_node: (N, 4), also of nodes that are not valid.
        """
        tangent, binormal, normal = axes_of(q_world_node)
        knots = np.concatenate([moment.anchor_m, moment.node_m])
        centre = self._position @ np.nan_to_num(knots) + self._slope @ tangent
        across, up = self._straight @ binormal, self._straight @ normal
        half: tuple[Float64 | float, Float64 | float] = (WIDTH_M / 2, THICKNESS_M / 2)
        if radius_m is not None:
            radius = (self._straight @ radius_m)[:, None, None]
            half = (radius, radius)
        ring = centre[:, None] + half[0] * self._cos * across[:, None] + half[1] * self._sin * up[:, None]
        return np.asarray(ring.reshape(-1, 3), np.float32)

    def faces(self, nodes: Bool) -> NDArray[np.uint32]:
        """(F, 3) triangles of the parts of the tubes that belong to the nodes (N,) that are marked."""
        return np.asarray(self._faces[nodes[self._face_node]])


def _tube_faces(rings: int) -> NDArray[np.int64]:
    """Triangles of a tube of so many rings, those between two rings together."""
    ring, side = np.arange(rings - 1)[:, None] * SIDES, np.arange(SIDES)
    beside = (side + 1) % SIDES
    a, b = ring + side, ring + beside
    c, d = ring + SIDES + beside, ring + SIDES + side
    return np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 2).reshape(-1, 3)
