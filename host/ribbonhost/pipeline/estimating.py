"""Poses that the motion estimator makes of readings, ribbon by ribbon, the reference of a comb first."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from ribbonhost.device import Scan
from ribbonhost.motion import LiveMotion, Motion
from ribbonhost.motion.anchor import start_weights
from ribbonhost.motion.live import update_each
from ribbonhost.motion.scans import Sampler
from ribbonhost.motion.sharing import Helpers
from ribbonhost.pipeline.arrangement import Arrangement
from ribbonhost.pipeline.poses import (
    Float64,
    MotionCounts,
    MotionMode,
    Moving,
    Pose,
    SourceOf,
    device_poses,
    reading_of,
)
from ribbonhost.pipeline.readings import Calibrations, Readings, Ribbons, age_s, read_s, samples_of


def source_of(
    motion: MotionMode,
    arrangement: Arrangement,
    *,
    rate_hz: int,
    calibrations: Calibrations,
    on_event: Callable[[str, str], None],
) -> SourceOf:
    """Where the poses of an arrangement's ribbons come from while their scans come.

    `on_event` is told of ribbons that cannot be estimated, and why.
    """
    if motion == "off":
        return device_poses
    return partial(LivePoses, Ribbons(arrangement, rate_hz, calibrations, on_event))


class LivePoses:
    """Estimates each scan, at its end, from the readings up to it. Not for several threads at once.

    What it makes depends on the scans and their order only.

    counts: of each ribbon.
    """

    def __init__(self, ribbons: Ribbons, places: Sequence[int]) -> None:
        """places: which of the ribbons, the reference first if there is a comb."""
        layout = ribbons.layout
        self._ribbons = [_Ribbon(ribbons.readings(index)) for index in places]
        self.counts = [ribbon.counts for ribbon in self._ribbons]
        self._starts = (
            start_weights(layout.node_count, layout.pitch_m, layout.start_m) if layout else np.zeros((0, 0))
        )
        self._reference: list[Pose] = []
        self._sampler_of_each = lru_cache(maxsize=8)(Sampler.of_each)
        # The reference comes first; then there is work for as many threads as there are cores.
        self._helpers = Helpers(max(0, min(len(places) - 1, os.cpu_count() or 1) - 1))

    def poses(self, scans: Sequence[tuple[int, Scan]]) -> list[Pose]:
        """See PoseSource."""
        waiting: dict[int, list[Scan]] = {}
        for index, scan in scans:
            waiting.setdefault(index, []).append(scan)
        made: dict[int, list[Pose]] = {index: [] for index in waiting}
        if len(self._starts) and 0 in waiting:
            made[0] = [self._poses({0: scan}, np.zeros((1, 3)))[0] for scan in waiting.pop(0)]
            self._reference = [*self._reference, *made[0]][-2:]
        for turn in range(max(map(len, waiting.values()), default=0)):
            turns = {index: queue[turn] for index, queue in waiting.items() if turn < len(queue)}
            for index, pose in zip(turns, self._poses(turns, self._known_mps2(turns)), strict=True):
                made[index].append(pose)
        order = {index: iter(poses) for index, poses in made.items()}
        return [next(order[index]) for index, _ in scans]

    def _poses(self, scans: Mapping[int, Scan], known_mps2: Float64) -> list[Pose]:
        """The poses of the next scan of each of some ribbons. known_mps2: (R, 3) of their anchors."""
        ribbons = [self._ribbons[index] for index in scans]
        reads = [ribbon.take(scan) for ribbon, scan in zip(ribbons, scans.values(), strict=True)]
        poses: list[Pose | None] = [None] * len(ribbons)
        rows = [row for row, read in enumerate(reads) if read]
        if rows:
            there = [read for read in reads if read]
            motion = self._update([ribbons[row] for row in rows], there, known_mps2[rows])
            for i, (row, read) in enumerate(zip(rows, there, strict=True)):
                poses[row] = pose_of(motion, i, read.t_host_s)
        return [
            ribbon.counted(scan, pose)
            for ribbon, scan, pose in zip(ribbons, scans.values(), poses, strict=True)
        ]

    def _update(self, ribbons: Sequence["_Ribbon"], reads: Sequence[Scan], known_mps2: Float64) -> Motion:
        sampler = self._sampler_of_each(tuple(ribbon.readings.sampler for ribbon in ribbons))
        samples = replace(samples_of(sampler, reads), anchor_mps2=known_mps2)
        # The readings are some time old when their scan ends, and the frame is of that moment.
        ahead_s = np.array([age_s(read) for read in reads])
        motions = [ribbon.motion for ribbon in ribbons if ribbon.motion]
        return update_each(motions, samples, ahead_s, self._helpers)

    def _known_mps2(self, scans: Mapping[int, Scan]) -> Float64:
        """(R, 3) acceleration of the places where ribbons start: that of the reference there and then."""
        moving = [(pose.t_host_s, pose.moving) for pose in self._reference if pose.moving]
        if not moving:
            return np.zeros((len(scans), 3))
        (t_s, newest), (before_s, before) = moving[-1], moving[0]
        at_s = [read_s(scan) for scan in scans.values()]
        share = np.array([(at - before_s) / (t_s - before_s) if before_s < at < t_s else 1.0 for at in at_s])
        weights = self._starts[[index - 1 for index in scans]]
        there = np.matmul(weights, [before.acceleration_mps2, newest.acceleration_mps2])
        return np.asarray(share[:, None] * there[1] + (1 - share[:, None]) * there[0])


def pose_of(motion: Motion, row: int, t_host_s: float) -> Pose | None:
    """The pose in a row of a motion; None if there is no estimate in it."""
    q_world_node = motion.q_world_node[row]
    if not np.isfinite(q_world_node).all():
        return None
    moving = Moving(
        motion.velocity_mps[row], motion.acceleration_mps2[row], motion.position_covariance_m2[row]
    )
    known = np.ones(len(q_world_node), np.bool_)
    return Pose(t_host_s, q_world_node, known, motion.sigma_rad[row], moving)


class _Ribbon:
    """The estimator of one ribbon.

    motion: None of a ribbon that cannot be estimated, and before its first readings.
    """

    def __init__(self, readings: Readings) -> None:
        self.counts = MotionCounts()
        self.readings = readings
        self.motion: LiveMotion | None = None
        self._restarts = 0

    def take(self, scan: Scan) -> Scan | None:
        """What of the next scan the estimator is to be given; None: nothing."""
        read, begins_anew = self.readings.take(scan)
        if begins_anew:
            self._restarts = self.counts.restarts + bool(self.motion)
            params = self.readings.params(scan)
            self.motion = LiveMotion(params) if params else None
        return read if self.motion else None

    def counted(self, scan: Scan, pose: Pose | None) -> Pose:
        """What became of a scan: the pose, or what the device says if there is none."""
        if self.motion:
            self.counts.restarts = self._restarts + self.motion.counters["restarts"]
        if pose is None:
            self.counts.level += 1
            return reading_of(scan)
        self.counts.estimated += scan.raw is not None
        self.counts.predicted += scan.raw is None
        return pose
