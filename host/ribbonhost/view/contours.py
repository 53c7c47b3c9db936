"""Cuts a mesh along the levels of a quantity, so that every band between two levels is a mesh of its own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Int64 = NDArray[np.int64]
Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class Cut:
    """Where the vertices of the bands lie on the edges of the mesh, and their triangles.

    a: (P,) vertices of the mesh. cut: (C,) which of the points lie between a and another vertex b: (C,).
    share: (C, 1) how far from a to b. bands: for each band the slice of its points and its (F, 3)
    triangles, counted from the slice's begin.
    """

    a: Int64
    cut: Int64
    b: Int64
    share: Float32
    bands: tuple[tuple[slice, NDArray[np.uint32]], ...]

    def points(self, vertices: Float32) -> Float32:
        """(P, 3) of the mesh's vertices (V, 3) as they are now."""
        points = vertices.take(self.a, axis=0)
        start = points.take(self.cut, axis=0)
        points[self.cut] = start + self.share * (vertices.take(self.b, axis=0) - start)
        return points


class Cutter:
    """Cuts one mesh of triangles (F, 3) on V vertices, for any values at the vertices."""

    def __init__(self, triangles: NDArray[np.integer]) -> None:
        self._triangles = triangles.astype(np.int64)
        self._vertex_count = int(triangles.max()) + 1
        ends = np.sort(self._triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=-1).reshape(-1, 2)
        edges, which = np.unique(ends, axis=0, return_inverse=True)
        self._edges = edges
        self._edge = which.reshape(-1, 3)

    def cut(self, level: NDArray[np.float64], there: NDArray[np.bool_], bands: int) -> Cut:
        """Band k holds what lies between the levels k and k + 1; beyond the ends counts as the end.

        level: (V,) value in units of a band, NaN where it is not known. there: (V,) which vertices there
        are. A last band, number `bands`, holds the triangles that are there without a value.
        """
        level = np.clip(level, 0.0, bands - 1e-6)
        triangles = self._triangles
        whole = np.all(there[triangles], axis=1)
        known = whole & np.isfinite(level[triangles]).all(axis=1)
        unknown = triangles[whole & ~known]
        triangles, edge = triangles[known], self._edge[known]
        values = level[triangles]
        low, high = np.floor(values.min(axis=1, initial=bands)), np.floor(values.max(axis=1, initial=0))
        inside = low == high
        faces = [triangles[inside], unknown]
        band = [low[inside].astype(np.int64), np.full(len(unknown), bands)]
        self._split(triangles[~inside], edge[~inside], values[~inside], bands, faces, band)
        return self._cut(np.concatenate(faces), np.concatenate(band), level, bands)

    def _split(
        self,
        triangles: Int64,
        edge: Int64,
        values: NDArray[np.float64],
        bands: int,
        faces: list[Int64],
        band: list[Int64],
    ) -> None:
        """Triangles that cross levels: between two levels lies a polygon of at most five corners.

        A point on an edge is named V + edge * (bands + 1) + level, so that neighbours share it.
        """
        if not len(triangles):
            return
        order = np.argsort(values, axis=1)
        # An odd order turns the triangle over; its pieces are turned back.
        odd = (order[:, 1] - order[:, 0]) % 3 == 2
        corner = np.take_along_axis(triangles, order, 1)
        value = np.take_along_axis(values, order, 1)
        # Edge k joins corners k and k + 1 of the triangle as given: that of two corners by their sum.
        by_sum = np.array([0, 0, 2, 1])
        rows = np.arange(len(triangles))
        long = edge[rows, by_sum[order[:, 0] + order[:, 2]]]
        lower = edge[rows, by_sum[order[:, 0] + order[:, 1]]]
        upper = edge[rows, by_sum[order[:, 1] + order[:, 2]]]
        first, last = np.floor(value[:, 0]).astype(np.int64), np.floor(value[:, 2]).astype(np.int64)
        count = last - first + 1
        row = np.repeat(rows, count)
        k = first[row] + np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)

        def point(on: Int64, level: Int64) -> Int64:
            return self._vertex_count + on * (bands + 1) + level

        at_first, at_last = k == first[row], k == last[row]
        middle = value[row, 1]
        bottom_long = np.where(at_first, corner[row, 0], point(long[row], k))
        bottom_short = np.where(
            at_first, corner[row, 0], point(np.where(k <= middle, lower[row], upper[row]), k)
        )
        top_long = np.where(at_last, corner[row, 2], point(long[row], k + 1))
        top_short = np.where(
            at_last, corner[row, 2], point(np.where(k + 1 <= middle, lower[row], upper[row]), k + 1)
        )
        has_middle = (middle >= k) & (middle < k + 1)
        between = np.where(has_middle, corner[row, 1], bottom_short)
        pieces = np.concatenate(
            [
                np.stack([bottom_long, bottom_short, between], 1),
                np.stack([bottom_long, between, top_short], 1),
                np.stack([bottom_long, top_short, top_long], 1),
            ]
        )
        turn = np.tile(odd[row], 3)
        pieces[turn] = pieces[turn][:, ::-1]
        a, b, c = pieces.T
        real = (a != b) & (b != c) & (a != c)
        faces.append(pieces[real])
        band.append(np.tile(k, 3)[real])

    def _cut(self, faces: Int64, band: Int64, level: NDArray[np.float64], bands: int) -> Cut:
        size = self._vertex_count + len(self._edges) * (bands + 1)
        order = np.argsort(band, kind="stable")
        faces, band = faces[order], band[order]
        names, which = np.unique(faces + band[:, None] * size, return_inverse=True)
        which = which.reshape(-1, 3)
        name, owner = names % size, names // size
        on_edge = np.maximum(name - self._vertex_count, 0)
        edge, at = on_edge // (bands + 1), on_edge % (bands + 1)
        is_cut = np.flatnonzero(name >= self._vertex_count)
        a, b = name, self._edges[edge[is_cut], 1]
        a[is_cut] = self._edges[edge[is_cut], 0]
        from_level, to_level = level[a[is_cut]], level[b]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.nan_to_num((at[is_cut] - from_level) / (to_level - from_level))
        starts = np.searchsorted(owner, np.arange(bands + 2))
        at_face = np.searchsorted(band, np.arange(bands + 2))
        return Cut(
            a,
            is_cut,
            b,
            np.clip(share, 0.0, 1.0).astype(np.float32)[:, None],
            tuple(
                (
                    slice(int(starts[k]), int(starts[k + 1])),
                    (which[at_face[k] : at_face[k + 1]] - starts[k]).astype(np.uint32),
                )
                for k in range(bands + 1)
            ),
        )
