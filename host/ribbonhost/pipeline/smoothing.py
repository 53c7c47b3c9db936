"""Poses of a whole recording, each estimated from the readings before and after it."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from ribbonhost.device import Scan
from ribbonhost.motion import Motion, smooth_recording
from ribbonhost.motion.anchor import start_weights
from ribbonhost.pipeline.estimating import pose_of
from ribbonhost.pipeline.poses import Float64, MotionCounts, Pose, reading_of
from ribbonhost.pipeline.readings import Readings, Ribbons, read_s, samples_of

Progress = Callable[[float], None]


class SmoothedPoses:
    """Estimates all scans of a recording at once, then gives them out as they come again.

    counts: of each ribbon.
    """

    def __init__(self, ribbons: Ribbons, places: Sequence[int]) -> None:
        """As for LivePoses."""
        self._ribbons = ribbons
        self._layout = ribbons.layout
        self._indices = list(places)
        self.counts = [MotionCounts() for _ in places]
        self._poses: list[list[Pose]] = [[] for _ in places]
        self._scans: list[list[Scan]] = [[] for _ in places]

    def smooth(self, scans: Sequence[Sequence[Scan]], progress: Progress) -> None:
        """Takes all scans of each ribbon of the arrangement, in order. progress: told the share done."""
        self._scans = [list(scans[index]) for index in self._indices]
        total = sum(map(len, self._scans)) or 1
        done = 0

        def advance(count: int) -> None:
            nonlocal done
            done += count
            progress(done / total)

        if self._layout is None:
            self._poses = [self._smoothed(i, None, advance) for i in range(len(self._indices))]
            return
        reference = self._smoothed(0, None, advance)
        known = _Carried(reference, self._layout.node_count, self._layout.pitch_m, self._layout.start_m)
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            others = pool.map(lambda i: self._smoothed(i, known, advance), range(1, len(self._indices)))
            self._poses = [reference, *others]

    def poses(self, scans: Sequence[tuple[int, Scan]]) -> list[Pose]:
        """See PoseSource."""
        found = []
        for index, scan in scans:
            count = self.counts[index]
            place = count.estimated + count.predicted + count.level
            known = self._scans[index]
            same = place < len(known) and known[place].t_device_us == scan.t_device_us
            pose = self._poses[index][place] if same else reading_of(scan)
            if pose.moving is None:
                count.level += 1
            else:
                count.estimated += scan.raw is not None
                count.predicted += scan.raw is None
            found.append(pose)
        return found

    def _smoothed(self, index: int, known: "_Carried | None", advance: Callable[[int], None]) -> list[Pose]:
        scans, poses = self._scans[index], list[Pose]()
        readings = self._ribbons.readings(self._indices[index])
        for part in _parts(scans, readings):
            poses += _estimates(part, readings, index, known)
            advance(len(part))
        return poses


def _parts(scans: Sequence[Scan], readings: Readings) -> list[list[tuple[Scan, Scan | None]]]:
    """Scans, each with what serves as its readings, in parts that are estimated each by itself."""
    parts: list[list[tuple[Scan, Scan | None]]] = []
    for scan in scans:
        read, begins_anew = readings.take(scan)
        if not parts or begins_anew:
            parts.append([])
        parts[-1].append((scan, read))
    return parts


def _estimates(
    part: Sequence[tuple[Scan, Scan | None]], readings: Readings, index: int, known: "_Carried | None"
) -> list[Pose]:
    poses = [reading_of(scan) for scan, _ in part]
    rows = [row for row, (_, read) in enumerate(part) if read]
    there = [read for _, read in part if read]
    if not there or (params := readings.params(there[0])) is None:
        return poses
    samples = samples_of(readings.sampler, there)
    at_s = np.array([read_s(scan) for scan in there])
    if known:
        samples = replace(samples, anchor_mps2=known.acceleration_mps2(index, at_s))
    motion: Motion = smooth_recording(samples, params)
    for row, pose_row, t_host_s in zip(rows, range(len(rows)), at_s.tolist(), strict=True):
        poses[row] = pose_of(motion, pose_row, t_host_s) or poses[row]
    return poses


class _Carried:
    """Acceleration of the places on the reference where the ribbons start, through a recording."""

    def __init__(
        self, reference: Sequence[Pose], node_count: int, pitch_m: float, start_m: Sequence[float]
    ) -> None:
        moving = [(pose.t_host_s, pose.moving) for pose in reference if pose.moving]
        order = np.argsort([t_s for t_s, _ in moving], kind="stable")
        self._t_s = np.array([t_s for t_s, _ in moving])[order]
        along = np.array([m.acceleration_mps2 for _, m in moving])
        self._there_mps2 = (
            np.einsum("rk,tkd->trd", start_weights(node_count, pitch_m, start_m), along[order])
            if len(moving)
            else np.zeros((0, len(start_m), 3))
        )

    def acceleration_mps2(self, index: int, t_s: Float64) -> Float64:
        """(T, 3) of ribbon `index`, from 1, at host times."""
        if not len(self._t_s):
            return np.zeros((len(t_s), 3))
        there = self._there_mps2[:, index - 1]
        return np.stack([np.interp(t_s, self._t_s, there[:, axis]) for axis in range(3)], axis=1)
