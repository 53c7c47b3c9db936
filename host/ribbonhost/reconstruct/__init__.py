"""From the orientations of sensor nodes to curves, combs, meshes and surfaces; needs no device.

World axes are east, north, up; node axes tangent, binormal, normal; quaternions unit, scalar first, from
node to world; metres and radians throughout. One ribbon, bent into a half circle about its binormal:

>>> import numpy as np
>>> from ribbonhost.reconstruct import RibbonSolver, bridge, curve_bending, ribbon_covariance, tube_radius_m
>>> ribbon = RibbonSolver(pitch_m=0.025, node_count=16)
>>> turn = np.pi * ribbon.node_s_m / ribbon.node_s_m[-1]
>>> q = np.stack([np.cos(turn / 2), 0 * turn, -np.sin(turn / 2), 0 * turn], axis=-1)
>>> ribbon.solve(q)[-1].round(3) + 0.0
array([0.   , 0.   , 0.493])
>>> curvature, torsion = curve_bending(ribbon.node_s_m, bridge(ribbon.node_s_m, q).tangent)
>>> bool(np.allclose(curvature, np.pi / ribbon.node_s_m[-1], rtol=1e-3))
True

How far its last node may be off if every node is known to half a degree:

>>> sigma_rad = np.full(16, np.radians(0.5))
>>> float(tube_radius_m(ribbon_covariance(ribbon.node_s_m, q, sigma_rad))[-1].round(4))
0.0048

A comb of three such ribbons on a straight reference, and its surface of 2 x 15 patches of 8 x 8 vertices:

>>> from ribbonhost.reconstruct import CombLayout, CombSolver
>>> solver = CombSolver(CombLayout(pitch_m=0.025, node_count=16, start_m=(0.0, 0.2, 0.4)))
>>> w, _, y, _ = q.T
>>> north = np.sqrt(0.5) * np.stack([w, -y, y, w], axis=-1)  # turned about z
>>> straight = np.tile([1.0, 0, 0, 0], (16, 1))
>>> frame = solver.solve(np.stack([straight, north, north, north]))
>>> frame.node_m[1:, -1].round(3) + 0.0
array([[0.   , 0.   , 0.493],
       [0.2  , 0.   , 0.493],
       [0.4  , 0.   , 0.493]])
>>> frame.vertices_m.shape
(2, 15, 8, 8, 3)
"""

from ribbonhost.reconstruct.comb import CombFrame, CombFrames, CombLayout, CombSolver
from ribbonhost.reconstruct.curve import curve_bending, curve_points
from ribbonhost.reconstruct.error import error_percent
from ribbonhost.reconstruct.mesh import MeshFrame, MeshLayout, MeshSolver
from ribbonhost.reconstruct.ribbon import RibbonSolver, bridge, node_arc_lengths
from ribbonhost.reconstruct.smoothing import LiveSmoother, smooth_recording
from ribbonhost.reconstruct.surface import patch_points, seam_angles_deg
from ribbonhost.reconstruct.uncertainty import comb_uncertainty, ribbon_covariance, tube_radius_m

__all__ = [
    "CombFrame",
    "CombFrames",
    "CombLayout",
    "CombSolver",
    "LiveSmoother",
    "MeshFrame",
    "MeshLayout",
    "MeshSolver",
    "RibbonSolver",
    "bridge",
    "comb_uncertainty",
    "curve_bending",
    "curve_points",
    "error_percent",
    "node_arc_lengths",
    "patch_points",
    "ribbon_covariance",
    "seam_angles_deg",
    "smooth_recording",
    "tube_radius_m",
]
