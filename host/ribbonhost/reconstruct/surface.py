"""The surface of a comb in double precision, evaluated where one wants it, and how smooth its seams are."""

import numpy as np

from ribbonhost.reconstruct.arguments import Float64
from ribbonhost.reconstruct.comb import CombFrame, CombLayout


def hermite_basis(u: Float64, derivative: int = 0) -> Float64:
    """(4, m) cubic Hermite functions on [0, 1] or their first derivative: values at 0, 1, slopes at 0, 1."""
    if derivative == 0:
        return np.stack([1 - 3 * u**2 + 2 * u**3, 3 * u**2 - 2 * u**3, u - 2 * u**2 + u**3, u**3 - u**2])
    return np.stack([6 * (u**2 - u), 6 * (u - u**2), 1 - 4 * u + 3 * u**2, 3 * u**2 - 2 * u])


def patch_points(
    layout: CombLayout, frame: CombFrame, u: Float64, v: Float64, along: int = 0, across: int = 0
) -> Float64:
    """Points, or their derivatives, of all patches: (R - 1, n - 1, len(u), len(v), 3), metres.

    u, v: parameters in [0, 1] along the ribbons and across them. along, across: order of the derivative
    by each, 0 or 1. Bicubically blended Coons patches with cubic borders (Coons 1974), which are
    bicubic, with the frame's twist.
    """
    ds = np.diff(layout.node_s_m)[None, :, None]
    dt = np.diff(np.array(layout.start_m))[:, None, None]
    corners = np.empty((len(dt), ds.shape[1], 4, 4, 3))
    for a in (0, 1):
        for b in (0, 1):
            at = slice(b, b + len(dt)), slice(a, a + ds.shape[1])
            corners[:, :, a, b] = frame.node_m[1:][at]
            corners[:, :, 2 + a, b] = ds * frame.along[at]
            corners[:, :, a, 2 + b] = dt * frame.transversal[at]
            corners[:, :, 2 + a, 2 + b] = ds * dt * frame.twist[at]
    return np.asarray(
        np.einsum("eu,jkefd,fv->jkuvd", hermite_basis(u, along), corners, hermite_basis(v, across))
    )


def seam_angles_deg(layout: CombLayout, frame: CombFrame, samples: int = 9) -> Float64:
    """Angle between the normals of neighbouring patches at `samples` points of every seam, degrees.

    One array of all seams, along and across; points without a normal are left out. The patches'
    derivatives are continuous by construction, so what is found is rounding.
    """
    inner, ends = np.linspace(0, 1, samples), np.array([0.0, 1.0])

    def normals(u: Float64, v: Float64) -> Float64:
        return np.cross(
            patch_points(layout, frame, u, v, along=1), patch_points(layout, frame, u, v, across=1)
        )

    between_nodes, between_ribbons = normals(ends, inner), normals(inner, ends)
    first = [between_nodes[:, :-1, 1].reshape(-1, 3), between_ribbons[:-1, :, :, 1].reshape(-1, 3)]
    second = [between_nodes[:, 1:, 0].reshape(-1, 3), between_ribbons[1:, :, :, 0].reshape(-1, 3)]
    a, b = np.concatenate(first), np.concatenate(second)
    a, b = (x[np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)] for x in (a, b))
    sine, cosine = np.linalg.norm(np.cross(a, b), axis=1), np.einsum("id,id->i", a, b)
    there = (sine > 0) | (cosine != 0)
    return np.asarray(np.degrees(np.arctan2(sine[there], cosine[there])))
