"""Combs of ribbons: one native call from the orientations of nodes to curves in place and a surface."""

from dataclasses import dataclass
from typing import Any, Literal, TypeGuard

import numpy as np

from ribbonhost.native._native import ffi, lib
from ribbonhost.reconstruct import arguments
from ribbonhost.reconstruct.arguments import Bool, Float32, Float64, doubles
from ribbonhost.reconstruct.curve import check_method
from ribbonhost.reconstruct.ribbon import node_arc_lengths

Method = Literal["spline", "hermite"]
Twist = Literal["measured", "zero"]

METHODS: dict[str, int] = {"spline": lib.RIBBON_METHOD_SPLINE, "hermite": lib.RIBBON_METHOD_HERMITE}
TWISTS: dict[str, int] = {"measured": lib.RIBBON_TWIST_MEASURED, "zero": lib.RIBBON_TWIST_ZERO}


def is_method(name: str) -> TypeGuard[Method]:
    """Whether there is a method of this name, for what was typed or read from a file."""
    return name in METHODS


@dataclass(frozen=True)
class CombLayout:
    """Where the nodes of a comb are: a reference ribbon and the ribbons that start on it, all alike.

    pitch_m: distance between neighbouring sensors of a ribbon. node_count: nodes n of each ribbon; node
    k sits (2k + 1) pitch_m from the anchor. start_m: where each of the R >= 2 ribbons starts on the
    reference, increasing, from 0 to the reference's last node. Raises ValueError for anything else.
    """

    pitch_m: float
    node_count: int
    start_m: tuple[float, ...]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.pitch_m) and self.pitch_m > 0):
            raise ValueError(f"pitch_m must be a positive length, not {self.pitch_m}")
        if not 2 <= self.node_count <= lib.RIBBON_NODE_LIMIT:
            raise ValueError(f"node_count must be 2 to {lib.RIBBON_NODE_LIMIT}, not {self.node_count}")
        if not 2 <= len(self.start_m) <= lib.RIBBON_RIBBON_LIMIT:
            raise ValueError(
                f"start_m must name 2 to {lib.RIBBON_RIBBON_LIMIT} ribbons, not {len(self.start_m)}"
            )
        arguments.arc_lengths("start_m", np.array(self.start_m, np.float64))
        if self.start_m[-1] > self.length_m:
            raise ValueError(
                f"start_m: {self.start_m[-1]} m lies beyond the reference's last node, {self.length_m} m"
            )

    @property
    def node_s_m(self) -> Float64:
        """(n,) arc length of the nodes from the anchor."""
        return node_arc_lengths(self.pitch_m, self.node_count)

    @property
    def length_m(self) -> float:
        """Arc length from the anchor to the last node."""
        return (2 * self.node_count - 1) * self.pitch_m


@dataclass(frozen=True)
class CombFrame:
    """One reconstructed frame: metres, ENU axes, origin at the reference's anchor.

    Index 0 of R + 1 is the reference. Of a missing ribbon inside the comb the values are those of the surface
    that spans from neighbour to neighbour; of one at an end they are NaN.

    anchor_m: (R + 1, 3) start of each ribbon.
    node_m: (R + 1, n, 3) positions of the nodes.
    tangent: (R + 1, n, 3) unit, along the ribbons.
    along: (R, n, 3) derivative of the surface by the arc length along the ribbons: the tangent, but for
    missing ribbons.
    transversal: (R, n, 3) derivative of the surface by the start arc length, along the binormal.
    lambda_: (R, n) its magnitude, always positive.
    twist: (R, n, 3) mixed derivative of the surface, 1/m.
    vertices_m, normals: (R - 1, n - 1, V, V, 3) float32, patch between ribbons j, j + 1 and nodes k, k
    + 1, third index along the ribbon, fourth across; shared borders are repeated. Normals are unit, on
    the side of the node z axes.
    lambda_limited: how many lambda had to be held at their minimum, RIBBON_LAMBDA_MIN.
    ribbon_valid: (R + 1,) False where a ribbon had no valid node. Without the reference the ribbons
    start on a straight line along x.
    bridged: (R + 1, n) nodes whose orientation came from their neighbours.
    """

    anchor_m: Float64
    node_m: Float64
    tangent: Float64
    along: Float64
    transversal: Float64
    lambda_: Float64
    twist: Float64
    vertices_m: Float32
    normals: Float32
    lambda_limited: int
    ribbon_valid: Bool
    bridged: Bool


@dataclass(frozen=True)
class CombFrames:
    """Many reconstructed frames: the arrays of CombFrame with an axis (frames,) before the others.

    lambda_limited: (frames,) int32. vertices_m and normals are empty unless patches were asked for.
    """

    anchor_m: Float64
    node_m: Float64
    tangent: Float64
    along: Float64
    transversal: Float64
    lambda_: Float64
    twist: Float64
    vertices_m: Float32
    normals: Float32
    lambda_limited: np.ndarray[tuple[int, ...], np.dtype[np.int32]]
    ribbon_valid: Bool
    bridged: Bool

    def __len__(self) -> int:
        return len(self.node_m)


class CombSolver:
    """Reconstructs frames of one comb. Not for use by two threads at once: each needs its own.

    method: how curves are reconstructed, see curve_points; "spline" is the better one, "hermite" the paper's.
    twist: mixed derivative of the patches at their corners, "measured" along the ribbons or "zero", the
    paper's. patch_vertices: vertices V along one side of a patch, 2 to 64.
    Raises ValueError for an unknown method or twist or a V out of range.
    """

    def __init__(
        self,
        layout: CombLayout,
        method: Method = "spline",
        patch_vertices: int = 8,
        twist: Twist = "measured",
    ) -> None:
        number = check_method(method, METHODS)
        if twist not in TWISTS:
            raise ValueError(f"twist must be one of {', '.join(TWISTS)}, not {twist!r}")
        if not 2 <= patch_vertices <= lib.RIBBON_PATCH_VERTEX_LIMIT:
            raise ValueError(
                f"patch_vertices must be 2 to {lib.RIBBON_PATCH_VERTEX_LIMIT}, not {patch_vertices}"
            )
        self.layout = layout
        r, n, v = len(layout.start_m), layout.node_count, patch_vertices
        self._nodes_shape = (r + 1, n)
        self._mesh_shape = (r - 1, n - 1, v, v, 3)
        self._s = ffi.new("double[]", layout.node_s_m.tolist())
        self._start = ffi.new("double[]", list(layout.start_m))
        self._comb = ffi.new("struct ribbon_comb *", (r, n, v, number, TWISTS[twist], self._s, self._start))
        self._workspace = ffi.new("double[]", lib.ribbon_comb_workspace(self._comb))
        self._frame = ffi.new("struct ribbon_comb_frame *")
        shapes = {
            "anchor": ("anchor_m", (r + 1, 3)),
            "node": ("node_m", (r + 1, n, 3)),
            "tangent": ("tangent", (r + 1, n, 3)),
            "along": ("along", (r, n, 3)),
            "transversal": ("transversal", (r, n, 3)),
            "twist": ("twist", (r, n, 3)),
            "lambda": ("lambda_", (r, n)),
        }
        self._parts: list[tuple[str, str, int, int, tuple[int, ...]]] = []
        self._size = 0
        for field, (name, shape) in shapes.items():
            count = int(np.prod(shape))
            self._parts.append((field, name, self._size, self._size + count, shape))
            self._size += count
        self._held = np.empty(0, np.int32)

    def solve(self, q_world_node: Float64, valid: Bool | None = None) -> CombFrame:
        """Curves and surface of one frame.

        q_world_node: (R + 1, n, 4) float64, unit, scalar first, turning node vectors into world
        vectors, reference first; where `valid` (R + 1, n) bool is False it is not read (None: all
        valid). Invalid nodes are bridged by their neighbours.
        Raises TypeError or ValueError naming the argument for a wrong type, shape, layout in memory,
        and for a quaternion that is marked valid but not finite or not unit (within 1e-3 of |q|^2).
        """
        arrays = self._solve(
            arguments.floats("q_world_node", q_world_node, *self._nodes_shape, 4),
            None if valid is None else arguments.flags("valid", valid, *self._nodes_shape),
            leading=(),
            patches=True,
        )
        return CombFrame(**arrays, lambda_limited=int(self._held[0]))

    def solve_many(
        self, q_world_node: Float64, valid: Bool | None = None, patches: bool = False
    ) -> CombFrames:
        """Curves and, if `patches`, vertices of many frames: q_world_node (frames, R + 1, n, 4), valid alike.

        Each frame as by `solve`; same errors.
        """
        q_world_node = arguments.floats("q_world_node", q_world_node, None, *self._nodes_shape, 4)
        frames = len(q_world_node)
        if valid is not None:
            valid = arguments.flags("valid", valid, frames, *self._nodes_shape)
        arrays = self._solve(q_world_node, valid, (frames,), patches)
        return CombFrames(**arrays, lambda_limited=self._held)

    def _solve(
        self, q_world_node: Float64, valid: Bool | None, leading: tuple[int, ...], patches: bool
    ) -> dict[str, Any]:
        """All arrays of a CombFrame with the axes `leading` before their own; leaves self._held new."""
        frames = leading[0] if leading else 1
        values = np.empty(frames * self._size)
        mesh = np.empty(
            (2, *leading, *self._mesh_shape) if patches else (2, 0, *self._mesh_shape), np.float32
        )
        ribbon_valid = np.empty((*leading, self._nodes_shape[0]), np.bool_)
        self._held = np.empty(frames, np.int32)
        frame, base = self._frame, doubles(values)
        arrays: dict[str, Any] = {}
        for field, name, first, last, shape in self._parts:
            setattr(frame, field, base + frames * first)
            arrays[name] = values[frames * first : frames * last].reshape(leading + shape)
        mesh_base = ffi.from_buffer("float[]", mesh)
        frame.vertices = mesh_base if patches else ffi.NULL
        frame.normals = mesh_base + mesh.size // 2 if patches else ffi.NULL
        frame.ribbon_valid = ffi.from_buffer("uint8_t[]", ribbon_valid)
        frame.held = ffi.from_buffer("int32_t[]", self._held)
        code = lib.ribbon_comb_frames(
            self._comb,
            frames,
            doubles(q_world_node),
            ffi.NULL if valid is None else ffi.from_buffer("uint8_t[]", valid),
            frame,
            self._workspace,
        )
        if code:
            arguments.raise_for(
                code, {lib.RIBBON_ERROR_NOT_FINITE: "q_world_node", lib.RIBBON_ERROR_NOT_UNIT: "q_world_node"}
            )
        if valid is None:
            arrays["bridged"] = np.zeros(leading + self._nodes_shape, np.bool_)
        else:
            arrays["bridged"] = ribbon_valid[..., None] & ~valid
        arrays["vertices_m"], arrays["normals"] = mesh
        arrays["ribbon_valid"] = ribbon_valid
        return arrays
