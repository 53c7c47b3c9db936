"""From the uncertainty of orientations to that of positions: along ribbons, on combs, over the surface."""

from dataclasses import dataclass, replace

import numpy as np

from ribbonhost.native._native import ffi, lib
from ribbonhost.reconstruct import arguments
from ribbonhost.reconstruct.arguments import Bool, Float64, doubles
from ribbonhost.reconstruct.comb import CombFrame, CombLayout
from ribbonhost.reconstruct.ribbon import Orientations, bridge
from ribbonhost.reconstruct.surface import hermite_basis

MEAN_SHARE = 1 / (7.814728 - 5.991465)
"""Of the square of a known offset in one direction, how much counts as variance there.

With it the 95 % region for three directions (chi-square 7.81) holds the truth as often as the one for the
other two (5.99), if the offset is all there is in the third.
"""

RANDOM_SHARE = 2.0
"""Of the variance of the shortening of the way, taken node by node, how much counts.

More than one: neighbouring nodes act on the same piece of the way, and a turn that shortens it more leads
farther aside. For one turn alone that makes 4.4; over ribbons of 4 to 64 nodes, straight and bent,
two holds the truth 93 to 97 % of the time.
"""


def position_sensitivity(
    node_s_m: Float64, orientations: Orientations, at_s_m: Float64
) -> tuple[Float64, Float64]:
    """How points move when nodes turn: (..., m, n, 3, 3) m/rad and (..., m, n, 3) m/rad^2.

    node_s_m: (n,) arc lengths, at_s_m: (m,) arc lengths within [0, node_s_m[-1]]. When node j turns by
    the small rotation vector r in world axes, point i moves by first[..., i, j] @ r - |r'|^2 / 2 *
    second[..., i, j], r' the part of r across the tangent. Nodes that are filled from it turn with it;
    the entries of a filled node are for an error of the filling itself. Of the "spline" method; the
    others differ from it by less than their own error.
    Raises TypeError or ValueError naming the argument.
    """
    node_s_m = arguments.arc_lengths("node_s_m", node_s_m)
    at_s_m = arguments.within("at_s_m", at_s_m, float(node_s_m[-1]))
    n, m = len(node_s_m), len(at_s_m)
    q = orientations.q_world_node
    first, second = np.empty((*q.shape[:-2], m, n, 3, 3)), np.empty((*q.shape[:-2], m, n, 3))
    code = lib.ribbon_sensitivity(
        q.size // (4 * n),
        n,
        doubles(node_s_m),
        doubles(q),
        ffi.from_buffer("uint8_t[]", np.ascontiguousarray(~orientations.bridged)),
        m,
        doubles(at_s_m),
        doubles(first),
        doubles(second),
        doubles(np.empty(lib.ribbon_sensitivity_workspace(n))),
    )
    arguments.raise_for(code, {lib.RIBBON_ERROR_COUNT: "node_s_m"})
    return first, second


def _node_sigma(sigma_rad: Float64, orientations: Orientations) -> Float64:
    """(..., n) standard deviation of each node's own error: as measured, or the spread of its filling."""
    sigma_rad = arguments.floats("sigma_rad", sigma_rad, *orientations.bridged.shape)
    measured = sigma_rad[~orientations.bridged]
    if not (measured >= 0).all() or np.isinf(measured).any():
        raise ValueError("sigma_rad must be finite and not negative where a node is valid")
    return np.where(orientations.bridged, orientations.spread_rad, sigma_rad)


def _turned_to(q: Float64, tangent: Float64, target: Float64) -> Float64:
    """Orientations (..., 4) turned the shortest way that takes unit `tangent` (..., 3) to unit `target`."""
    aw = 1 + np.sum(tangent * target, axis=-1, keepdims=True)
    av = np.cross(tangent, target)
    bw, bv = q[..., :1], q[..., 1:]
    w = aw * bw - np.sum(av * bv, axis=-1, keepdims=True)
    turned = np.concatenate([w, aw * bv + bw * av + np.cross(av, bv)], axis=-1)
    return np.ascontiguousarray(turned / np.linalg.norm(turned, axis=-1, keepdims=True))


def _without_noise(orientations: Orientations, sigma: Float64) -> Orientations:
    """The same with tangents drawn together to spread only by what noise does not explain.

    sigma: (..., n) standard deviation of each node. A straight ribbon that errors bend looks as if turns of
    its nodes moved points along it, by more than they truly do in second order. Noise counts as two
    standard deviations more than its mean, which the sum of its 2 n squares seldom exceeds.
    """
    tangent = orientations.tangent
    measured = ~orientations.bridged[..., None]
    count = measured.sum(axis=-2, keepdims=True)
    mean = (tangent * measured).sum(axis=-2, keepdims=True) / count
    deviation = tangent - mean
    spread = (deviation**2 * measured).sum(axis=(-2, -1))[..., None, None]
    mean_noise = 2 * (sigma[..., None] ** 2 * measured).sum(axis=-2, keepdims=True)
    noise = mean_noise * (1 - 1 / count + 2 / np.sqrt(count))
    share = np.sqrt(np.maximum(1 - noise / np.maximum(spread, 1e-300), 0))
    target = mean + share * deviation
    length = np.linalg.norm(target, axis=-1, keepdims=True)
    target = np.where(length > 0.1, target / np.maximum(length, 0.1), tangent)
    return replace(orientations, q_world_node=_turned_to(orientations.q_world_node, tangent, target))


def _square_root(
    node_s_m: Float64, orientations: Orientations, sigma_rad: Float64, at_s_m: Float64
) -> Float64:
    """(..., m, 3, 4 n + 1) roots J, J J^T the covariance of the points; first 3 n columns: turns of nodes.

    The others are of second order: errors shorten the way along the curve, at random and on average (last
    column). Without them the region would have no thickness along a straight ribbon.
    """
    node_sigma = _node_sigma(sigma_rad, orientations)
    first, second = position_sensitivity(node_s_m, _without_noise(orientations, node_sigma), at_s_m)
    sigma = node_sigma[..., None, :]
    turns = np.moveaxis(first * sigma[..., None, None], -3, -2)
    shorter = np.swapaxes(second * sigma[..., None] ** 2, -1, -2)
    mean = np.sqrt(MEAN_SHARE) * shorter.sum(axis=-1, keepdims=True)
    random = np.sqrt(RANDOM_SHARE) * shorter
    return np.concatenate([turns.reshape(*turns.shape[:-2], -1), random, mean], axis=-1)


def ribbon_covariance(
    node_s_m: Float64,
    q_world_node: Float64,
    sigma_rad: Float64,
    valid: Bool | None = None,
    at_s_m: Float64 | None = None,
) -> Float64:
    """Covariance (..., m, 3, 3) of points along ribbons, m^2, world axes, the anchor without error.

    node_s_m, q_world_node, valid: as for bridge. sigma_rad: (..., n) standard deviation of each node's
    orientation about any axis, independent from node to node; not read of invalid nodes, whose own
    error is that of their filling. at_s_m: (m,) arc lengths; None: the nodes. First-order propagation
    through the curve. Raises TypeError or ValueError naming the argument.
    """
    orientations = bridge(node_s_m, q_world_node, valid)
    root = _square_root(node_s_m, orientations, sigma_rad, node_s_m if at_s_m is None else at_s_m)
    return root @ np.swapaxes(root, -1, -2)


def tube_radius_m(covariance_m2: Float64, probability: float = 0.95) -> Float64:
    """(...) longest semi-axis of the region that holds a point with this probability, from (..., 3, 3)."""
    from scipy.special import gammaincinv

    chi_square = 2 * gammaincinv(1.5, probability)
    return np.asarray(np.sqrt(chi_square * np.linalg.eigvalsh(covariance_m2)[..., -1].clip(0)))


@dataclass(frozen=True)
class CombUncertainty:
    """Covariances of the points of a comb frame, m^2, world axes, the reference's anchor without error.

    anchor_m2: (R + 1, 3, 3). node_m2: (R + 1, n, 3, 3), NaN for missing ribbons. vertices_m2: (R - 1, n
    - 1, V, V, 3, 3) as the vertices of the frame, spanning missing ribbons as they do; NaN where the
    surface is.
    """

    anchor_m2: Float64
    node_m2: Float64
    vertices_m2: Float64


def comb_uncertainty(
    layout: CombLayout,
    frame: CombFrame,
    q_world_node: Float64,
    sigma_rad: Float64,
    valid: Bool | None = None,
    patch_vertices: int = 8,
) -> CombUncertainty:
    """What the uncertainty of the orientations makes of a frame that CombSolver solved from them.

    q_world_node: (R + 1, n, 4), valid: (R + 1, n) as they were solved. sigma_rad: (R + 1, n) as for
    ribbon_covariance. First order: errors of the reference carry whole ribbons with them; those of
    tangents and binormals tilt the patches. Not included: what the surface does between the ribbons
    where nothing is measured.
    Raises TypeError or ValueError naming the argument; ValueError also if the reference is missing.
    """
    ribbons, n = len(layout.start_m), layout.node_count
    q_world_node = arguments.floats("q_world_node", q_world_node, ribbons + 1, n, 4)
    sigma_rad = arguments.floats("sigma_rad", sigma_rad, ribbons + 1, n)
    valid = np.ones((ribbons + 1, n), np.bool_) if valid is None else valid
    there: Bool = np.any(arguments.flags("valid", valid, ribbons + 1, n), axis=1)
    if not there[0]:
        raise ValueError(
            "valid marks no node of the reference as valid: nothing is known of where ribbons start"
        )
    s = layout.node_s_m
    present = np.flatnonzero(there)
    orientations = bridge(s, q_world_node[present], valid[present])
    points = np.concatenate([s, layout.start_m])
    root = np.full((ribbons + 1, len(points), 3, 4 * n + 1), np.nan)
    root[present] = _square_root(s, orientations, sigma_rad[present], points)
    start, own = root[0, n:], root[:, :n]
    anchor = np.concatenate([np.zeros((1, 3, 3)), start @ start.swapaxes(-1, -2)])
    node_sigma = np.full((ribbons + 1, n), np.nan)
    node_sigma[present] = _node_sigma(sigma_rad[present], orientations)
    return CombUncertainty(
        anchor_m2=anchor,
        node_m2=anchor[:, None] + own @ own.swapaxes(-1, -2),
        vertices_m2=_vertices(layout, frame, there[1:], start, own[1:], node_sigma[1:], patch_vertices),
    )


def _cross(v: Float64) -> Float64:
    """(..., 3, 3) matrices that turn a small rotation vector into the movement of v."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack(
        [np.stack([zero, z, -y], -1), np.stack([-z, zero, x], -1), np.stack([y, -x, zero], -1)], axis=-2
    )


def _vertices(
    layout: CombLayout,
    frame: CombFrame,
    there: Bool,
    start: Float64,
    own: Float64,
    node_sigma: Float64,
    patch_vertices: int,
) -> Float64:
    """Covariances of the vertices; patches next to a missing ribbon are parts of the wide ones that span it.

    start: (R, 3, 4 n + 1) square roots of the starts, own: (R, n, 3, 4 n + 1) of the nodes of each ribbon.
    """
    ribbons, n = own.shape[:2]
    u = np.linspace(0, 1, patch_vertices)
    s, starts = layout.node_s_m, np.array(layout.start_m)
    out = np.full((ribbons - 1, n - 1, patch_vertices, patch_vertices, 3, 3), np.nan)
    for j in range(ribbons - 1):
        left, right = np.flatnonzero(there[: j + 1])[-1:], np.flatnonzero(there[j + 1 :])[:1] + j + 1
        if len(left) == 0 or len(right) == 0:
            continue
        sides = (int(left[0]), int(right[0]))
        width = starts[sides[1]] - starts[sides[0]]
        v = (starts[j] + u * (starts[j + 1] - starts[j]) - starts[sides[0]]) / width
        across = hermite_basis(v)
        common = np.einsum("bv,bdx->vdx", across[:2], start[list(sides)])
        covariance = (common @ common.swapaxes(-1, -2))[None, None]
        for side, ribbon in enumerate(sides):
            point, slope = _border(
                hermite_basis(u), np.diff(s), own[ribbon], node_sigma[ribbon], frame, ribbon
            )
            move = across[side][:, None, None] * point[:, :, None]
            move += width * across[2 + side][:, None, None] * slope[:, :, None]
            covariance = covariance + move @ move.swapaxes(-1, -2)
        out[j] = covariance
    return out


def _border(
    along: Float64, ds: Float64, own: Float64, sigma: Float64, frame: CombFrame, ribbon: int
) -> tuple[Float64, Float64]:
    """Square roots (n - 1, V, 3, 4 n + 1) of the points of a border and of the derivative across it."""
    n = len(sigma)
    tilt = np.zeros((2, n, 3, n, 3))
    nodes = np.arange(n)
    for kind, v in enumerate((frame.along[ribbon], frame.transversal[ribbon])):
        tilt[kind, nodes, :, nodes] = _cross(v) * sigma[:, None, None]
    padding = ((0, 0), (0, 0), (0, 0), (0, own.shape[-1] - 3 * n))
    tangent, transversal = np.pad(tilt.reshape(2, n, 3, 3 * n), padding)
    point = np.einsum("v,kdx->kvdx", along[0], own[:-1]) + np.einsum("v,kdx->kvdx", along[1], own[1:])
    point += np.einsum("v,k,kdx->kvdx", along[2], ds, tangent[:-1])
    point += np.einsum("v,k,kdx->kvdx", along[3], ds, tangent[1:])
    slope = np.einsum("v,kdx->kvdx", along[0], transversal[:-1]) + np.einsum(
        "v,kdx->kvdx", along[1], transversal[1:]
    )
    return point, slope
