"""What a scan says of its ribbon: orientations, how sure they are, and how they move."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, TypeGuard

import numpy as np
from numpy.typing import NDArray

from ribbonhost import wire
from ribbonhost.device import Scan

Float64 = NDArray[np.float64]

MotionMode = Literal["off", "live", "offline"]
"""Where orientations come from: as the device says; estimated from its readings up to each scan; or, of a
recording, from those before and after it."""

MODES: tuple[MotionMode, ...] = ("off", "live", "offline")


def is_mode(name: str) -> TypeGuard[MotionMode]:
    """Whether there is a mode of this name, for what was typed or read from a file."""
    return name in MODES


@dataclass(frozen=True, slots=True)
class Moving:
    """How n nodes move, from their ribbon's anchor, world directions.

    velocity_mps, acceleration_mps2: (n, 3). position_covariance_m2: (n, 3, 3).
    """

    velocity_mps: Float64
    acceleration_mps2: Float64
    position_covariance_m2: Float64


@dataclass(frozen=True, slots=True)
class Pose:
    """A ribbon of n nodes at one moment.

    t_host_s: the moment: the end of the scan, to which the device extrapolates and an estimate is carried on;
        that of the readings for what is estimated two-sided.
    q_world_node: (n, 4) unit. known: (n,) nodes that have an orientation. sigma_rad: (n,) its standard
        deviation, worst axis; NaN where that is not known.
    moving: None if the orientations are the device's.
    """

    t_host_s: float
    q_world_node: Float64
    known: NDArray[np.bool_]
    sigma_rad: Float64
    moving: Moving | None = None


@dataclass
class MotionCounts:
    """What became of the scans of a ribbon, since its stream began.

    estimated: scans with an estimate from their readings. predicted: with one carried on from those before,
    for their readings did not come. level: with the device's level reading, for there was no estimate.
    restarts: how often the estimator was lost and started again.
    """

    estimated: int = 0
    predicted: int = 0
    level: int = 0
    restarts: int = 0

    def __sub__(self, earlier: "MotionCounts") -> "MotionCounts":
        return MotionCounts(
            self.estimated - earlier.estimated,
            self.predicted - earlier.predicted,
            self.level - earlier.level,
            self.restarts - earlier.restarts,
        )


class PoseSource(Protocol):
    """Makes poses of scans."""

    @property
    def counts(self) -> Sequence[MotionCounts]:
        """Of each ribbon; empty where nothing is estimated."""

    def poses(self, scans: Sequence[tuple[int, Scan]]) -> list[Pose]:
        """The poses of the next scans, each with the index of its ribbon, in the order of their arrival."""


SourceOf = Callable[[Sequence[int]], PoseSource]
"""Makes the source of poses of some of the ribbons of an arrangement, the reference of a comb first."""


def reading_of(scan: Scan) -> Pose:
    """The orientations as the device says them."""
    return Pose(scan.t_host_s, scan.q_world_node, scan.valid, wire.sigma_rad(scan.quality))


class DevicePoses:
    """Orientations as the devices say them."""

    counts: Sequence[MotionCounts] = ()

    def poses(self, scans: Sequence[tuple[int, Scan]]) -> list[Pose]:
        """See PoseSource."""
        return [reading_of(scan) for _, scan in scans]


def device_poses(places: Sequence[int]) -> PoseSource:
    """A SourceOf that estimates nothing."""
    return DevicePoses()
