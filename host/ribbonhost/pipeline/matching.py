"""Which scans of several ribbons make one frame of the comb, and what all of them read at its moment."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ribbonhost.device import Scan
from ribbonhost.pipeline.poses import DevicePoses, Moving, PoseSource

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

SILENT_S = 0.5
"""A ribbon that delivered nothing for so long is not waited for."""


@dataclass(frozen=True)
class Match:
    """r ribbons of n nodes at one moment.

    Attributes:
        t_host_s: the moment: that of the oldest of the new poses.
        q_world_node: (r, n, 4) unit.
        valid: (r, n) bool, as the device said; False for all nodes of a ribbon that is silent.
        known: (r, n) bool: nodes with an orientation: all of a ribbon whose motion is estimated, else those
            that are valid.
        sigma_rad: (r, n) standard deviation of the orientations, worst axis; NaN where it is not known.
        moving: how the ribbons move, each from its own anchor; None of a ribbon that is not estimated.
        scans: the new scans, by their ribbon's index.
    """

    t_host_s: float
    q_world_node: Float64
    valid: Bool
    known: Bool
    sigma_rad: Float64
    moving: tuple[Moving | None, ...]
    scans: dict[int, Scan]


class Matcher:
    """Collects scans of r ribbons of n nodes into matches.

    A scan is new if it ended more than half a period after the moment of the match before. A match is
    complete when each live ribbon has delivered a new scan. One that delivers a second new scan while
    another has delivered none does not wait: the late one's newest scan is held. So nothing waits for
    longer than a period, and scans that come too late do not delay those after them.

    Attributes:
        live: (r,) bool: ribbons that deliver.
        held: (r,) how often the newest scan of a ribbon was held.
    """

    def __init__(self, ribbons: int, nodes: int, period_s: float, source: PoseSource | None = None) -> None:
        """source: makes poses of all scans, in their order; None: orientations as the devices say them."""
        self.live = np.zeros(ribbons, dtype=bool)
        self.held = np.zeros(ribbons, dtype=np.int64)
        self._source = source or DevicePoses()
        self._new_after_s = -np.inf
        self._half_period_s = period_s / 2
        self._waiting: list[tuple[int, Scan, bool]] = []
        self._new: dict[int, Scan] = {}
        self._heard_s = np.full(ribbons, -np.inf)
        self._t_s = np.zeros((2, ribbons))
        self._q = np.zeros((2, ribbons, nodes, 4))
        self._q[..., 0] = 1.0
        self._known = np.zeros((2, ribbons, nodes), dtype=bool)
        self._valid = np.zeros((ribbons, nodes), dtype=bool)
        self._sigma_rad = np.full((ribbons, nodes), np.nan)
        self._moving: list[Moving | None] = [None] * ribbons

    def add(self, ribbon: int, scan: Scan, now_s: float) -> list[Match]:
        """Takes the next scan of a ribbon; returns the matches that it completes, at most two."""
        matches = []
        if ribbon in self._new:
            matches.append(self._match())
        self._waiting.append((ribbon, scan, not self.live[ribbon]))
        self._heard_s[ribbon] = now_s
        self.live[ribbon] = True
        if scan.t_host_s > self._new_after_s:
            self._new[ribbon] = scan
            if len(self._new) == np.count_nonzero(self.live):
                matches.append(self._match())
        return matches

    def expire(self, now_s: float) -> list[int]:
        """Takes silent ribbons out of the live ones and returns them; their next scan brings them back."""
        silent = np.flatnonzero(self.live & (self._heard_s < now_s - SILENT_S))
        self.live[silent] = False
        for ribbon in silent:
            self._new.pop(int(ribbon), None)
        return [int(ribbon) for ribbon in silent]

    def lose(self, ribbon: int) -> bool:
        """Takes a ribbon whose link is gone out of the live ones, as `expire` does; False if it was out."""
        was_live = bool(self.live[ribbon])
        self.live[ribbon] = False
        self._new.pop(ribbon, None)
        return was_live

    def _match(self) -> Match:
        scans, self._new = self._new, {}
        late = self.live.copy()
        late[list(scans)] = False
        self.held += late
        self._new_after_s = min(scan.t_host_s for scan in scans.values()) + self._half_period_s
        self._pose()
        t_host_s = float(self._t_s[1, list(scans)].min())
        # What the device says is for the end of a scan, and may be asked for the time of readings.
        said = np.array([moving is None for moving in self._moving])
        back = None if said.all() else said
        q_world_node, known = interpolate(self._t_s, self._q, self._known, t_host_s, back=back)
        live = self.live[:, None]
        return Match(
            t_host_s,
            q_world_node,
            self._valid & live,
            known & live,
            self._sigma_rad.copy(),
            tuple(self._moving),
            scans,
        )

    def _pose(self) -> None:
        """Makes poses of the scans that wait, and keeps the newest two of each ribbon."""
        waiting, self._waiting = self._waiting, []
        poses = self._source.poses([(ribbon, scan) for ribbon, scan, _ in waiting])
        for (ribbon, scan, gap), pose in zip(waiting, poses, strict=True):
            kept = ((self._t_s, pose.t_host_s), (self._q, pose.q_world_node), (self._known, pose.known))
            for older_newer, value in kept:
                older_newer[0, ribbon] = value if gap else older_newer[1, ribbon]
                older_newer[1, ribbon] = value
            self._valid[ribbon] = scan.valid
            self._sigma_rad[ribbon] = pose.sigma_rad
            self._moving[ribbon] = pose.moving


def interpolate(
    t_s: Float64, q: Float64, valid: Bool, at_s: float, *, back: Bool | None = None
) -> tuple[Float64, Bool]:
    """Orientations of r ribbons at one moment between two scans of each, held outside of them.

    The normalised linear interpolation of quaternions: between scans a hundredth of a second apart it differs
    from the great arc by less than the noise.

    Args:
        t_s: (2, r) when the scans ended, the older first.
        q: (2, r, n, 4) unit; the sign of a quaternion has no meaning.
        valid: (2, r, n). A node that is valid in the newer scan only is taken from there.
        at_s: the moment.
        back: (r,) ribbons that are extrapolated to a moment up to one step before the older scan.

    Returns:
        (r, n, 4) unit quaternions and (r, n) valid, as in the newer scan.
    """
    newer = q[1]
    older = np.where(valid[0, ..., None], q[0], newer)
    span_s = t_s[1] - t_s[0]
    least_s = 0.0 if back is None else np.where(back, -span_s, 0.0)
    since_s = np.clip(at_s - t_s[0], least_s, span_s)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(span_s > 0, since_s / span_s, 1.0)[:, None, None]
        same_side = np.where(np.einsum("rni,rni->rn", older, newer) < 0, -1.0, 1.0)[..., None]
        mixed = share * newer + (1.0 - share) * same_side * older
        mixed /= np.sqrt(np.einsum("rni,rni->rn", mixed, mixed))[..., None]
    return mixed, valid[1]
