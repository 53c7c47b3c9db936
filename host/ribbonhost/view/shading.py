"""What a surface is coloured by: the quantity, its scale, its colours and its legend."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ribbonhost.reconstruct import ribbon_covariance, tube_radius_m
from ribbonhost.view.layout import Float64, Layout, Moment

COLOURS = (
    (71, 16, 99), (71, 45, 123), (64, 70, 136), (54, 93, 141), (44, 114, 142), (36, 134, 142),
    (31, 154, 138), (40, 174, 128), (72, 193, 110), (117, 208, 84), (173, 220, 48), (229, 228, 25),
)  # fmt: skip
"""Viridis: even steps of lightness, told apart also by eyes that confuse red and green."""

BANDS = len(COLOURS)
PLAIN = (150, 178, 214)

SHRINK_BELOW = 0.35
"""A scale becomes finer when nothing reaches this share of it."""


def node_radius_m(layout: Layout, moment: Moment) -> Float64:
    """(N,) longest semi-axis of the region that holds a node with 95 % probability; NaN if not known.

    As the estimate of motion says; without one, from the sigma of each orientation. In a comb, the ribbon's
    start carries the error of the reference.
    """
    covariance = _covariance_m2(layout, moment)
    for part in moment.parts:
        if part.motion:
            estimated = part.motion.position_covariance_m2
            nodes = np.concatenate([np.arange(layout.node_count)[layout.slices[k]] for k in part.places])
            flat = estimated.reshape(-1, 3, 3)
            has_any = np.isfinite(flat).all(axis=(1, 2))
            covariance[nodes[has_any]] = flat[has_any]
    radius = np.full(layout.node_count, np.nan)
    known = np.isfinite(covariance).all(axis=(1, 2))
    radius[known] = tube_radius_m(covariance[known])
    return radius


def _covariance_m2(layout: Layout, moment: Moment) -> Float64:
    """(N, 3, 3) of the nodes' positions from the sigma of their orientations; NaN if not known."""
    usable = moment.known & np.isfinite(moment.sigma_rad)
    sigma_rad = np.nan_to_num(moment.sigma_rad)
    covariance = np.full((layout.node_count, 3, 3), np.nan)
    for at, s_m in zip(layout.slices, layout.node_s_m, strict=True):
        if usable[at].any():
            covariance[at] = ribbon_covariance(s_m, moment.q_world_node[at], sigma_rad[at], usable[at])
    if layout.comb is None:
        return covariance
    at, s_m = layout.slices[0], layout.node_s_m[0]
    if not usable[at].any():
        return np.full_like(covariance, np.nan)
    starts = np.array(layout.comb.start_m)
    start = ribbon_covariance(s_m, moment.q_world_node[at], sigma_rad[at], usable[at], at_s_m=starts)
    covariance[at.stop :] += np.repeat(start, layout.node_counts[0], axis=0)
    return covariance


def node_error_m(moment: Moment) -> Float64:
    """(N,) distance of each node from where it truly is; NaN where that is not known."""
    if moment.truth_m is None:
        return np.full(len(moment.node_m), np.nan)
    return np.asarray(np.linalg.norm(moment.node_m - moment.truth_m, axis=-1))


def node_curvature_per_m(layout: Layout, moment: Moment) -> Float64:
    """(N,) larger principal curvature of the surface at each node, as magnitude; NaN on the reference.

    From the first and second fundamental form; the second derivatives along the ribbons and across them are
    differences of the surface's first ones between neighbouring nodes.
    """
    out = np.full(layout.node_count, np.nan)
    if layout.comb is None or moment.comb is None:
        return out
    there = np.isfinite(moment.comb.along).all(axis=(1, 2))
    if np.count_nonzero(there) < 2:
        return out
    along, across, twist = (
        array[there] for array in (moment.comb.along, moment.comb.transversal, moment.comb.twist)
    )
    along_along = np.gradient(along, layout.comb.node_s_m, axis=1)
    across_across = np.gradient(across, np.array(layout.comb.start_m)[there], axis=0)
    normal = np.cross(across, along)
    with np.errstate(divide="ignore", invalid="ignore"):
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        e, f, g = _dot(along, along), _dot(along, across), _dot(across, across)
        k, m, n = (_dot(second, normal) for second in (along_along, twist, across_across))
        area = e * g - f * f
        mean, gauss = (e * n - 2 * f * m + g * k) / (2 * area), (k * n - m * m) / area
        curvature = np.abs(mean) + np.sqrt(np.maximum(mean**2 - gauss, 0.0))
    out.reshape(len(layout.labels), -1)[1:][there] = curvature
    return out


def _dot(a: Float64, b: Float64) -> Float64:
    return np.asarray(np.einsum("rni,rni->rn", a, b))


@dataclass(frozen=True)
class Quantity:
    """Something to colour by.

    name: in the menu and the legend. unit: as shown; factor: units in one SI unit.
    smallest: the scale is never finer, in the unit. of_nodes: (N,) values at nodes, SI.
    signed: the scale begins at the smallest value, not at 0. share: of the values that fit on the scale; the
    others have the colour of its end.
    """

    name: str
    unit: str
    factor: float
    smallest: float
    of_nodes: Callable[[Layout, Moment], Float64]
    signed: bool = False
    share: float = 0.97


PLAIN_COLOUR = "one colour"
ERROR = Quantity("error", "mm from the true place", 1e3, 0.2, lambda layout, moment: node_error_m(moment))
SIGMA = Quantity("uncertainty", "mm, 95 %", 1e3, 1.0, node_radius_m)
HEIGHT = Quantity("height", "mm", 1e3, 10.0, lambda layout, moment: moment.node_m[:, 2], signed=True)
CURVATURE = Quantity("curvature", "1/m", 1.0, 0.5, node_curvature_per_m, share=0.85)
"""Where ribbons nearly meet, the curvature of the surface between them is huge."""
QUANTITIES = {quantity.name: quantity for quantity in (CURVATURE, HEIGHT, SIGMA, ERROR)}


class Scale:
    """From values to bands, with round ends that change seldom."""

    def __init__(self, quantity: Quantity) -> None:
        self.quantity = quantity
        self.low, self.high = 0.0, quantity.smallest

    def levels(self, values: Float64) -> Float64:
        """Values (SI) in units of a band, counted from the scale's begin; adapts the scale to them."""
        shown = values * self.quantity.factor
        finite = shown[np.isfinite(shown)]
        if len(finite):
            self._adapt(finite)
        return (shown - self.low) * (BANDS / (self.high - self.low))

    def legend(self) -> str:
        """The colours and what they mean, as HTML."""
        stops = ", ".join(
            f"rgb{colour} {100 * k / BANDS:.2f}% {100 * (k + 1) / BANDS:.2f}%"
            for k, colour in enumerate(COLOURS)
        )
        ticks = "".join(f"<span>{value:.6g}</span>" for value in np.linspace(self.low, self.high, 5))
        return (
            '<div style="padding:2px 10px 6px;font-size:0.85em">'
            f"<b>{self.quantity.name}</b>, {self.quantity.unit}"
            f'<div style="height:14px;margin:4px 0 2px;border-radius:3px;'
            f'background:linear-gradient(to right, {stops})"></div>'
            f'<div style="display:flex;justify-content:space-between">{ticks}</div></div>'
        )

    def _adapt(self, shown: Float64) -> None:
        top = float(np.quantile(shown, self.quantity.share))
        bottom = float(np.quantile(shown, 1 - self.quantity.share)) if self.quantity.signed else 0.0
        span = max(top - bottom, self.quantity.smallest)
        outside = top > self.high + 0.02 * span or (self.quantity.signed and bottom < self.low - 0.02 * span)
        if outside or span < SHRINK_BELOW * (self.high - self.low):
            step = round_step(span / 4)
            self.low = step * math.floor(bottom / step + 1e-6)
            steps = max(4, math.ceil((top - self.low) / step - 1e-6))
            self.high = self.low + step * (4 * math.ceil(steps / 4))


def round_step(value: float) -> float:
    """The smallest of 1, 2, 2.5, 5 times a power of ten that is not smaller."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(k * power for k in (1.0, 2.0, 2.5, 5.0, 10.0) if k * power >= value * (1 - 1e-9))
