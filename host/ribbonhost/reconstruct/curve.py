"""Curves of ribbons from the tangents at their nodes, by each of the three methods; many frames at once."""

from typing import Literal

import numpy as np

from ribbonhost.native._native import lib
from ribbonhost.reconstruct import arguments
from ribbonhost.reconstruct.arguments import Float64, doubles

Method = Literal["spline", "hermite", "spherical"]
METHODS: dict[str, int] = {
    "spline": lib.RIBBON_METHOD_SPLINE,
    "hermite": lib.RIBBON_METHOD_HERMITE,
    "spherical": lib.RIBBON_METHOD_SPHERICAL,
}


def check_method(method: str, known: dict[str, int]) -> int:
    """The C solver's number of a method; raises ValueError."""
    if method not in known:
        raise ValueError(f"method must be one of {', '.join(known)}, not {method!r}")
    return known[method]


BLOCK_FRAMES = 512
"""Frames that are worked on at once: what is made of them in between stays in the processor's cache."""


class _Tracer:
    """Curves of blocks of frames by one method, with memory for one block.

    position: (frames, knots, 3), shape: what else the method's curves are made of, both of the last block.
    """

    def __init__(self, method: int, node_s_m: Float64, frames: int) -> None:
        self.n = len(node_s_m)
        self.knots = self.n + int(node_s_m[0] > 0)
        self._method = method
        self._node_s_m = node_s_m
        self.position = np.empty((frames, self.knots, 3))
        width = self.knots if method == lib.RIBBON_METHOD_HERMITE else self.n
        self.shape = np.empty((frames, width, 3))
        self._workspace = np.empty(5 * self.n)

    def trace(self, tangent: Float64) -> None:
        """Fills position and shape from tangents (frames, n, 3); raises ValueError if they are not unit."""
        names = {lib.RIBBON_ERROR_NOT_FINITE: "tangent", lib.RIBBON_ERROR_NOT_UNIT: "tangent"}
        arguments.raise_for(lib.ribbon_check_directions(len(tangent) * self.n, doubles(tangent)), names)
        given = len(tangent), self.n, doubles(self._node_s_m), doubles(tangent)
        common = *given, doubles(self.position), doubles(self.shape)
        if self._method == lib.RIBBON_METHOD_HERMITE:
            code = lib.ribbon_hermite_update(*common)
        elif self._method == lib.RIBBON_METHOD_SPLINE:
            code = lib.ribbon_spline_update(*common, doubles(self._workspace))
        else:
            code = lib.ribbon_spherical_update(*common, doubles(self._workspace))
        arguments.raise_for(code, {lib.RIBBON_ERROR_COUNT: "node_s_m"})

    def points(self, tangent: Float64, at_s_m: Float64, out: Float64) -> None:
        """Fills out (frames, m, 3) with points of the last block's curves at arc lengths (m,)."""
        common = len(tangent), self.n, doubles(self._node_s_m)
        last = doubles(self.position), doubles(self.shape), len(at_s_m), doubles(at_s_m), doubles(out)
        if self._method == lib.RIBBON_METHOD_HERMITE:
            code = lib.ribbon_hermite_points(*common, *last)
        elif self._method == lib.RIBBON_METHOD_SPLINE:
            code = lib.ribbon_spline_points(*common, doubles(tangent), *last)
        else:
            code = lib.ribbon_spherical_points(*common, doubles(tangent), *last)
        arguments.raise_for(code, {lib.RIBBON_ERROR_OUTSIDE: "at_s_m"})


def _flat(node_s_m: Float64, tangent: Float64) -> Float64:
    """Tangents of checked shape as (frames, n, 3)."""
    arguments.arc_lengths("node_s_m", node_s_m)
    n = len(node_s_m)
    return arguments.floats("tangent", tangent, "...", n, 3).reshape(-1, n, 3)


def curve_points(
    node_s_m: Float64, tangent: Float64, at_s_m: Float64 | None = None, method: Method = "spline"
) -> Float64:
    """Points of the curves that have the given tangents at their nodes, metres; the anchor is the origin.

    node_s_m: (n,) arc lengths of the nodes from the anchor.
    tangent: (..., n, 3) unit; each of the leading axes is a frame of its own.
    at_s_m: (m,) arc lengths within [0, node_s_m[-1]]; None: at the nodes. Returns (..., m, 3) in the
    axes of the tangents. A frame that the spherical method cannot solve, because its tangents turn too
    far from node to node, is NaN.

    "spline": cubic spline of the tangents, normalised and integrated: unit speed, fourth order.
    "hermite": step 1b of Sprynski, Lacolle, Biard 2011, section 3.1, in closed form: second order.
    "spherical": their step 1a, appendix A, after Nielson 2004.
    Raises TypeError or ValueError naming the argument. Calls from several threads run at the same time.
    """
    number = check_method(method, METHODS)
    flat = _flat(node_s_m, tangent)
    if at_s_m is not None:
        at_s_m = arguments.within("at_s_m", at_s_m, float(node_s_m[-1]))
    out = np.empty((len(flat), len(node_s_m) if at_s_m is None else len(at_s_m), 3))
    tracer = _Tracer(number, node_s_m, min(len(flat), BLOCK_FRAMES))
    for first in range(0, len(flat), BLOCK_FRAMES):
        block = flat[first : first + BLOCK_FRAMES]
        tracer.trace(block)
        if at_s_m is None:
            out[first : first + len(block)] = tracer.position[: len(block), tracer.knots - tracer.n :]
        else:
            tracer.points(block, at_s_m, out[first : first + len(block)])
    return out.reshape(*tangent.shape[:-2], *out.shape[1:])


def curve_bending(node_s_m: Float64, tangent: Float64) -> tuple[Float64, Float64]:
    """Curvature and torsion (..., 2 n - 1) at the nodes and half way between them, 1/m, node first.

    Arguments and errors as for curve_points. From the default method's spline; torsion is positive for a
    right-handed helix and 0 where there is no curvature.
    Source: the Frenet formulas for a tangent v / |v|.
    """
    flat = _flat(node_s_m, tangent)
    frames, n, _ = flat.shape
    tracer = _Tracer(lib.RIBBON_METHOD_SPLINE, node_s_m, frames)
    tracer.trace(flat)
    curvature, torsion = np.empty((2, frames, 2 * n - 1))
    lib.ribbon_curvature(
        frames,
        n,
        doubles(node_s_m),
        doubles(flat),
        doubles(tracer.shape),
        doubles(curvature),
        doubles(torsion),
    )
    shape = (*tangent.shape[:-2], 2 * n - 1)
    return curvature.reshape(shape), torsion.reshape(shape)
