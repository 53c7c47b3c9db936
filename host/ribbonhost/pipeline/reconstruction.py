"""Scans in, frames out, and what there is to say about both: the same for a stream and for a recording."""

import math
import time
from collections.abc import Callable, Collection, Iterable
from dataclasses import replace

from ribbonhost.device import Counters, Device, Scan
from ribbonhost.pipeline.arrangement import Arrangement, Place
from ribbonhost.pipeline.health import unfit_slots
from ribbonhost.pipeline.matching import SILENT_S
from ribbonhost.pipeline.poses import MotionCounts, SourceOf, device_poses
from ribbonhost.pipeline.report import CombReport, Report, RibbonReport
from ribbonhost.pipeline.solving import CombTask, CurveTask, OnSolved, Truth
from ribbonhost.pipeline.tally import Tally
from ribbonhost.reconstruct.comb import Method


class Reconstruction:
    """Matches and reconstructs the scans of an arrangement of ribbons, and counts.

    What it makes depends on the scans, their order and their times only, never on when it is called: so a
    recording gives what the stream gave. One thread may call `take` and `expire`, another `report`.
    """

    def __init__(
        self,
        arrangement: Arrangement,
        *,
        rate_hz: int,
        method: Method,
        truth: Truth | None = None,
        on_event: Callable[[str, str], None] = lambda label, what: None,
        on_solved: Iterable[OnSolved] = (),
        source_of: SourceOf = device_poses,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """`on_event` is told what happened to which ribbon, each of `on_solved` each frame;
        `source_of`: where poses come from; `now_s`: what durations are measured with."""
        self._places = arrangement.places
        self._rate_hz = rate_hz
        self._on_event = on_event
        self._on_solved = tuple(on_solved)
        self._now_s = now_s
        self._tasks: list[CombTask | CurveTask]
        if arrangement.layout:
            everyone = range(len(self._places))
            sources = [source_of(everyone)]
            self._tasks = [CombTask(arrangement.layout, rate_hz, method, truth, sources[0])]
        else:
            sources = [source_of([i]) for i in range(len(self._places))]
            self._tasks = [
                CurveTask(i, place.pitch_m, place.node_count, rate_hz, method, sources[i])
                for i, place in enumerate(self._places)
            ]
        self._motion = [counts for source in sources for counts in source.counts]
        self._motion_before = [replace(counts) for counts in self._motion]
        self._where = {place: (task, i) for task in self._tasks for i, place in enumerate(task.places)}
        self._silent: set[int] = set()
        self._before: dict[Device, Counters] = {}
        self._tally = Tally(len(self._places), now_s)
        self._held_before = self._held()
        self._dropped_before = 0
        self._last: Report | None = None

    @property
    def is_comb(self) -> bool:
        """Whether it makes surfaces, not just curves."""
        return isinstance(self._tasks[0], CombTask)

    def start_counting(self, dropped: int = 0) -> None:
        """Reports tell what happens from now on. `dropped`: scans that were dropped so far."""
        self._before = {place.device: place.device.counters() for place in self._places if place.device}
        self._held_before = self._held()
        self._motion_before = [replace(counts) for counts in self._motion]
        self._dropped_before = dropped
        self._tally = Tally(len(self._places), self._now_s)
        self._last = None

    def take(self, place: int, scan: Scan) -> None:
        """Uses the next scan of a ribbon."""
        self.expire(scan.t_arrival_s)
        task, index = self._where[place]
        if place in self._silent:
            self._silent.remove(place)
            self._on_event(self._places[place].label, "delivers again")
        for match in task.matcher.add(index, scan, scan.t_arrival_s):
            if solved := task.solve(match, self._tally):
                for tell in self._on_solved:
                    tell(solved)

    def lose(self, place: int) -> None:
        """No longer waits for a ribbon whose link is gone, and no longer holds what it said last."""
        task, index = self._where[place]
        if task.matcher.lose(index):
            self._silent.add(place)

    def expire(self, t_host_s: float) -> None:
        """No longer waits for ribbons that were silent for SILENT_S at a host time."""
        for task in self._tasks:
            for index in task.matcher.expire(t_host_s):
                place = task.places[index]
                self._silent.add(place)
                self._on_event(
                    self._places[place].label, f"delivered nothing for {SILENT_S:g} s: not waited for"
                )

    def report(
        self,
        *,
        failed: Collection[Device] = (),
        is_aligned: Callable[[Device], bool] = lambda device: False,
        dropped: int = 0,
    ) -> Report:
        """What happened since the count began; rates are over the time since the report before.

        failed: devices that were given up. is_aligned: whether a device scans in step with the others.
        dropped: scans that were dropped so far, before they came here.
        """
        tally, last = self._tally, self._last
        t_s = self._now_s() - tally.t_start_s
        interval_s = max(t_s - (last.t_s if last else 0.0), 1e-3)
        ribbons = []
        for index, place in enumerate(self._places):
            counters = self._counted(place)
            before = last.ribbons[index].counters.frames if last else 0
            aligned = place.device is not None and is_aligned(place.device)
            ribbons.append(
                self._ribbon_report(
                    index,
                    interval_s,
                    (counters.frames - before) / interval_s,
                    counters,
                    place.device in failed,
                    aligned,
                )
            )
        mean, smallest, largest = tally.error_percent
        comb = CombReport(
            frames=tally.frames,
            surfaces=tally.surfaces,
            surfaces_per_s=(tally.surfaces - (last.comb.surfaces if last else 0)) / interval_s,
            latency_p50_s=tally.latency.quantile_s(0.5),
            latency_p99_s=tally.latency.quantile_s(0.99),
            age_p50_s=tally.age.quantile_s(0.5),
            lambda_limited=tally.lambda_limited,
            unsolved=tally.unsolved,
            dropped=dropped - self._dropped_before,
            scan_spread_p50_s=tally.scan_spread.quantile_s(0.5),
            error_mean_percent=mean,
            error_min_percent=smallest,
            error_max_percent=largest,
            cpu_percent=tally.cpu_percent,
        )
        self._last = Report(t_s, self._rate_hz, tuple(ribbons), comb)
        return self._last

    def _counted(self, place: Place) -> Counters:
        """What came from a device since the count began."""
        if place.device is None or place.device not in self._before:
            return Counters()
        return place.device.counters() - self._before[place.device]

    def _held(self) -> list[int]:
        """How often the newest scan of each ribbon was held since the devices were started."""
        return [int(held) for task in self._tasks for held in task.matcher.held]

    def _level_per_s(self, index: int, interval_s: float) -> float:
        moved, before = self._moved(index), self._last.ribbons[index].motion if self._last else None
        return (moved.level - (before.level if before else 0)) / interval_s if moved else 0.0

    def _moved(self, index: int) -> MotionCounts | None:
        """What the estimator made of a ribbon's scans since the count began; None if there is none."""
        return self._motion[index] - self._motion_before[index] if self._motion else None

    def _ribbon_report(
        self,
        index: int,
        interval_s: float,
        frames_per_s: float,
        counters: Counters,
        has_failed: bool,
        aligned: bool,
    ) -> RibbonReport:
        place = self._places[index]
        device = place.device
        latency = self._tally.ribbon_latency[index]
        status = device.status if device else None
        live = [bool(live) for task in self._tasks for live in task.matcher.live][index]
        if device is None or has_failed:
            state = "missing"
        elif device.lost:
            state = "gone" if device.info else "absent"
        else:
            state = "streaming" if live else "silent"
        return RibbonReport(
            label=place.label,
            serial=place.serial,
            state=state,
            times_gone=device.absences.count if device else 0,
            gone_s=device.absences.total_s(self._now_s()) if device else 0.0,
            frames_per_s=frames_per_s,
            counters=counters,
            motion=self._moved(index),
            level_per_s=self._level_per_s(index, interval_s),
            latency_p50_s=latency.quantile_s(0.5),
            latency_p99_s=latency.quantile_s(0.99),
            held=self._held()[index] - self._held_before[index],
            drift_ppm=device.clock.drift_ppm if device else 0.0,
            round_trip_s=device.clock.round_trip_s if device else math.nan,
            clock_restarts=device.clock.restarts if device else 0,
            aligned=aligned,
            overruns=status.overruns if status else None,
            frames_dropped=status.frames_dropped if status else None,
            temperature_c=None
            if status is None or math.isnan(status.temperature_c)
            else round(status.temperature_c, 2),
            unfit=unfit_slots(status),
            slot_count=len(status.slots) if status else 0,
        )
