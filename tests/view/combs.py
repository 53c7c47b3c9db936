"""Made-up moments of a comb for the tests of the view."""

import numpy as np
from ribbonhost import wire
from ribbonhost.reconstruct import CombLayout
from ribbonhost.view.layout import Layout, Moment, Solver

COMB = CombLayout(0.025, 16, (0.0, 0.15, 0.3, 0.45))
LAYOUT = Layout(("reference", "a", "b", "c", "d"), (16,) * 5, (0.025,) * 5, COMB)


def cylinder(radius_m: float) -> np.ndarray:
    """(5, 16, 4) orientations: a straight reference to the east, ribbons to the north bent upwards."""
    angle = COMB.node_s_m / radius_m
    straight = np.tile([1.0, 0.0, 0.0, 0.0], (16, 1))
    turn = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    up = np.stack([np.cos(angle / 2), 0 * angle, -np.sin(angle / 2), 0 * angle], -1)
    w, x, y, z = turn
    left = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    return np.stack([straight, *[up @ left.T] * 4])


def moment(t_s: float = 0.0, radius_m: float = 0.5, quality: int = 5) -> Moment:
    """A bent sheet, all nodes valid."""
    q = cylinder(radius_m).reshape(-1, 4)
    known, valid = np.ones((2, len(q)), np.bool_)
    flags = np.full(len(q), quality, np.uint8)
    return Solver(LAYOUT, "spline").solve(t_s, q, known, valid, wire.sigma_rad(flags), flags)
