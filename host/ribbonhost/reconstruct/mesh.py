"""Meshes of ribbons that cross at sensors, the paper's second acquisition, closed by least squares."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ribbonhost.native._native import ffi, lib
from ribbonhost.reconstruct import arguments
from ribbonhost.reconstruct.arguments import Bool, Float32, Float64, doubles
from ribbonhost.reconstruct.curve import METHODS, Method, check_method, curve_points
from ribbonhost.reconstruct.ribbon import bridge


@dataclass(frozen=True)
class MeshLayout:
    """Two families of ribbons, warp and weft; every ribbon crosses all of the other family at a node of both.

    warp_s_m, weft_s_m: arc lengths of the n nodes of each warp ribbon and the m nodes of each weft
    ribbon. warp_crossing: which nodes of a warp ribbon lie on weft ribbons 0 ... Q - 1; weft_crossing:
    which nodes of a weft ribbon lie on warp ribbons 0 ... P - 1. Both grow, and name two or more.
    Raises ValueError for anything else.
    """

    warp_s_m: tuple[float, ...]
    weft_s_m: tuple[float, ...]
    warp_crossing: tuple[int, ...]
    weft_crossing: tuple[int, ...]

    def __post_init__(self) -> None:
        for family in ("warp", "weft"):
            s = arguments.arc_lengths(f"{family}_s_m", np.array(getattr(self, f"{family}_s_m"), np.float64))
            name, crossing = f"{family}_crossing", getattr(self, f"{family}_crossing")
            if len(crossing) < 2 or any(b <= a for a, b in pairwise(crossing)):
                raise ValueError(f"{name} must name two or more nodes, each greater than the one before")
            if crossing[0] < 0 or crossing[-1] >= len(s):
                raise ValueError(f"{name} must name nodes 0 to {len(s) - 1}")


@dataclass(frozen=True)
class MeshFrame:
    """One reconstructed frame: metres, ENU axes, origin at the first crossing that is known.

    P warp ribbons of n nodes, Q weft ribbons of m. Crossings of two missing ribbons are NaN.

    crossing_m: (P, Q, 3). warp_m: (P, n, 3), weft_m: (Q, m, 3) nodes of the ribbons, moved onto the
    crossings; NaN for missing ribbons. along, across: (P, Q, 3) unit, along the warp and the weft.
    twist: (P, Q, 3) mixed derivative.
    vertices_m, normals: (P - 1, Q - 1, V, V, 3) float32, patches between warp ribbons i, i + 1 and weft
    ribbons j, j + 1, third index along the warp. misfit_m: root mean square of what the ways between
    neighbouring crossings had to be changed by. warp_valid: (P,), weft_valid: (Q,) False where a ribbon
    had no valid node.
    """

    crossing_m: Float64
    warp_m: Float64
    weft_m: Float64
    along: Float64
    across: Float64
    twist: Float64
    vertices_m: Float32
    normals: Float32
    misfit_m: float
    warp_valid: Bool
    weft_valid: Bool


@dataclass(frozen=True)
class _Family:
    """Curves of one family, each from its own anchor, and directions at the crossings."""

    node_m: Float64  # (ribbons, nodes, 3)
    tangent: Float64  # (ribbons, crossings, 3)
    binormal: Float64  # (ribbons, crossings, 3)
    valid: Bool  # (ribbons,)


class MeshSolver:
    """Reconstructs frames of one mesh.

    The shape of each ribbon is known but for its place. The ways along ribbons between neighbouring
    crossings are measurements, with variances in proportion to their length; the crossings are the
    least-squares solution. method: as for curve_points. patch_vertices: vertices V along one side of a
    patch, 2 to 64.
    Raises ValueError for an unknown method or a V out of range.
    """

    def __init__(self, layout: MeshLayout, method: Method = "spline", patch_vertices: int = 8) -> None:
        check_method(method, METHODS)
        if not 2 <= patch_vertices <= lib.RIBBON_PATCH_VERTEX_LIMIT:
            raise ValueError(
                f"patch_vertices must be 2 to {lib.RIBBON_PATCH_VERTEX_LIMIT}, not {patch_vertices}"
            )
        self.layout = layout
        self._method: Method = method
        self._side = patch_vertices
        self._warp_s, self._weft_s = np.array(layout.warp_s_m), np.array(layout.weft_s_m)
        self._at_weft = self._warp_s[list(layout.warp_crossing)]
        self._at_warp = self._weft_s[list(layout.weft_crossing)]
        self._solutions: dict[bytes, Float64] = {}

    def solve(
        self,
        q_warp: Float64,
        q_weft: Float64,
        warp_valid: Bool | None = None,
        weft_valid: Bool | None = None,
    ) -> MeshFrame:
        """Curves and surface of one frame.

        q_warp: (P, n, 4), q_weft: (Q, m, 4) float64, unit, scalar first, turning node vectors into
        world vectors; not read where warp_valid (P, n) or weft_valid (Q, m) is False. Invalid nodes are
        bridged by their neighbours.
        Raises TypeError or ValueError naming the argument; ValueError also if a whole family is missing.
        """
        layout = self.layout
        warp = self._family(
            "warp", q_warp, warp_valid, self._warp_s, layout.warp_crossing, len(self._at_warp)
        )
        weft = self._family(
            "weft", q_weft, weft_valid, self._weft_s, layout.weft_crossing, len(self._at_weft)
        )
        ways = np.concatenate(
            [
                np.diff(warp.node_m[:, list(layout.warp_crossing)], axis=1).reshape(-1, 3),
                np.diff(weft.node_m[:, list(layout.weft_crossing)], axis=1).reshape(-1, 3),
            ]
        )
        known = np.isfinite(ways[:, 0])
        crossing = self._solution(warp.valid, weft.valid) @ ways[known]
        crossing[~(warp.valid[:, None] | weft.valid).ravel()] = np.nan
        misfit = (self._differences() @ crossing)[known] - ways[known]
        crossing = crossing.reshape(len(self._at_warp), len(self._at_weft), 3)
        along, across, facing = _directions(warp, weft, crossing)
        twist = (self._slope(self._at_weft, across, 1) + self._slope(self._at_warp, along, 0)) / 2
        vertices, normals = self._patches(crossing, along, across, twist, facing)
        return MeshFrame(
            crossing_m=crossing,
            warp_m=_move(warp.node_m, self._warp_s, layout.warp_crossing, crossing),
            weft_m=_move(weft.node_m, self._weft_s, layout.weft_crossing, crossing.swapaxes(0, 1)),
            along=along,
            across=across,
            twist=twist,
            vertices_m=vertices,
            normals=normals,
            misfit_m=float(np.sqrt(np.mean(np.sum(misfit**2, axis=1)))),
            warp_valid=warp.valid,
            weft_valid=weft.valid,
        )

    def _family(
        self, name: str, q: object, valid: object, s: Float64, crossing: tuple[int, ...], ribbons: int
    ) -> _Family:
        q = arguments.floats(f"q_{name}", q, ribbons, len(s), 4)
        flags = (
            np.ones((ribbons, len(s)), np.bool_)
            if valid is None
            else arguments.flags(f"{name}_valid", valid, ribbons, len(s))
        )
        arguments.unit(f"q_{name}", q[flags])
        there: Bool = np.any(flags, axis=1)
        if not there.any():
            raise ValueError(f"{name}_valid marks no node as valid")
        orientations = bridge(s, np.ascontiguousarray(q[there]), np.ascontiguousarray(flags[there]))
        node = np.full((ribbons, len(s), 3), np.nan)
        tangent, binormal = np.full((2, ribbons, len(crossing), 3), np.nan)
        node[there] = curve_points(s, orientations.tangent, method=self._method)
        tangent[there] = orientations.tangent[:, list(crossing)]
        binormal[there] = orientations.binormal[:, list(crossing)]
        return _Family(node, tangent, binormal, there)

    def _differences(self) -> Float64:
        """(ways, crossings) matrix that takes crossings to the ways between neighbours, warp ways first."""
        p, q = len(self._at_warp), len(self._at_weft)
        warp = np.kron(np.eye(p), np.diff(np.eye(q), axis=0))
        weft = np.kron(np.diff(np.eye(p), axis=0), np.eye(q))
        return np.concatenate([warp, weft.reshape(p - 1, q, p * q).swapaxes(0, 1).reshape(-1, p * q)])

    def _solution(self, warp_valid: Bool, weft_valid: Bool) -> Float64:
        """(crossings, known ways) matrix that takes the ways of the present ribbons to the crossings."""
        key = warp_valid.tobytes() + weft_valid.tobytes()
        if key not in self._solutions:
            p, q = len(self._at_warp), len(self._at_weft)
            known = np.concatenate([np.repeat(warp_valid, q - 1), np.repeat(weft_valid, p - 1)])
            length = np.concatenate([np.tile(np.diff(self._at_weft), p), np.tile(np.diff(self._at_warp), q)])
            weight = 1 / np.sqrt(length[known])
            solution = np.linalg.pinv(weight[:, None] * self._differences()[known]) * weight
            first = np.flatnonzero((warp_valid[:, None] | weft_valid).ravel())[0]
            self._solutions[key] = solution - solution[first]
        return self._solutions[key]

    def _slope(self, s: Float64, value: Float64, axis: int) -> Float64:
        """Derivative by s along an axis of the crossings; 0 where it is not known."""
        from scipy.interpolate import CubicSpline

        slope = np.asarray(CubicSpline(s, np.nan_to_num(value), axis=axis)(s, 1))
        unknown = np.isnan(value).any(axis=(axis, 2), keepdims=True)
        return np.where(unknown, 0.0, slope)

    def _patches(
        self, crossing: Float64, along: Float64, across: Float64, twist: Float64, facing: float
    ) -> tuple[Float32, Float32]:
        p, q = crossing.shape[:2]
        mesh = np.empty((2, p - 1, q - 1, self._side, self._side, 3), np.float32)
        code = lib.ribbon_patches(
            p,
            q,
            doubles(self._at_weft),
            doubles(self._at_warp),
            doubles(np.ascontiguousarray(crossing)),
            doubles(np.ascontiguousarray(along)),
            doubles(np.ascontiguousarray(across)),
            doubles(np.ascontiguousarray(twist)),
            self._side,
            facing,
            ffi.from_buffer("float[]", mesh[0]),
            ffi.from_buffer("float[]", mesh[1]),
        )
        arguments.raise_for(code, {lib.RIBBON_ERROR_COUNT: "layout"})
        return mesh[0], mesh[1]


def _directions(warp: _Family, weft: _Family, crossing: Float64) -> tuple[Float64, Float64, float]:
    """Unit vectors (P, Q, 3) along the warp and the weft, and on which side of their product node z is.

    Where one of the two ribbons is missing, the binormal of the other stands in, in the sense of the
    crossings.
    """
    lead_along, lead_across = np.gradient(crossing, axis=1), np.gradient(crossing, axis=0)
    weft_tangent, weft_binormal = weft.tangent.swapaxes(0, 1), weft.binormal.swapaxes(0, 1)
    instead_along = weft_binormal * np.sign(np.nansum(lead_along * weft_binormal))
    instead_across = warp.binormal * np.sign(np.nansum(lead_across * warp.binormal))
    along = np.where(warp.valid[:, None, None], warp.tangent, instead_along)
    across = np.where(weft.valid[None, :, None], weft_tangent, instead_across)
    up = np.nansum(np.cross(along, across) * np.cross(warp.tangent, warp.binormal))
    return along, across, -1.0 if up < 0 else 1.0


def _move(node_m: Float64, s: Float64, crossing: tuple[int, ...], crossing_m: Float64) -> Float64:
    """Nodes (ribbons, n, 3) moved onto the crossings: by a correction that is linear in s between them."""
    at = list(crossing)
    correction = crossing_m - node_m[:, at]
    moved = node_m.copy()
    for ribbon in range(len(node_m)):
        for d in range(3):
            moved[ribbon, :, d] += np.interp(s, s[at], correction[ribbon, :, d])
    return moved
