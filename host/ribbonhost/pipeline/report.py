"""What a stream has done, as values and as JSON."""

import math
from dataclasses import asdict, dataclass

from ribbonhost.device import Counters
from ribbonhost.pipeline.health import Unfit, sentence
from ribbonhost.pipeline.poses import MotionCounts

JsonObject = dict[str, object]


@dataclass(frozen=True)
class RibbonReport:
    """One ribbon.

    Attributes:
        state: "streaming", "silent", "absent" (not there yet, and looked for), "missing" (not there, or given
            up), or "gone" (its port vanished).
        times_gone, gone_s: how often and for how long its port was gone, or it not there yet.
        frames_per_s: over the last interval.
        motion: what became of its scans where motion is estimated; None where it is not.
        level_per_s: of these, those without an estimate, over the last interval.
        latency_p50_s, latency_p99_s: from the end of a scan to the surface in memory.
        held: frames of the comb for which its newest scan came too late.
        drift_ppm: how much longer a second of its clock is than one of the host's.
        round_trip_s: of the quickest ping.
        clock_restarts: how often its clock started anew.
        aligned: whether its scans are kept in step with the others'.
        overruns, frames_dropped: as its STATUS says, since it started; None before the first.
        temperature_c: as its STATUS says; None if it does not.
        unfit: sensors that its calibration does not fit, as its STATUS says.
        slot_count: sensors that it has.
    """

    label: str
    serial: str
    state: str
    times_gone: int
    gone_s: float
    frames_per_s: float
    counters: Counters
    motion: MotionCounts | None
    level_per_s: float
    latency_p50_s: float
    latency_p99_s: float
    held: int
    drift_ppm: float
    round_trip_s: float
    clock_restarts: int
    aligned: bool
    overruns: int | None
    frames_dropped: int | None
    temperature_c: float | None
    unfit: tuple[Unfit, ...]
    slot_count: int

    def health(self) -> str:
        """What does not fit the calibration, and what to do, in a line; empty if all does."""
        return sentence(self.unfit, self.slot_count)

    def as_json(self) -> JsonObject:
        """The object that `stream --json` prints."""
        return {
            "ribbon": self.label,
            "serial": self.serial,
            "state": self.state,
            "times_gone": self.times_gone,
            "gone_s": round(self.gone_s, 3),
            "frames_per_s": round(self.frames_per_s, 2),
            **asdict(self.counters),
            "motion": asdict(self.motion) if self.motion else None,
            "latency_ms": {"p50": _ms(self.latency_p50_s), "p99": _ms(self.latency_p99_s)},
            "held": self.held,
            "drift_ppm": round(self.drift_ppm, 2),
            "round_trip_ms": _ms(self.round_trip_s),
            "clock_restarts": self.clock_restarts,
            "aligned": self.aligned,
            "overruns": self.overruns,
            "frames_dropped": self.frames_dropped,
            "temperature_c": self.temperature_c,
            "unfit": [one.as_json() for one in self.unfit],
        }


@dataclass(frozen=True)
class CombReport:
    """All ribbons together.

    Attributes:
        frames: moments that were reconstructed.
        surfaces: frames with a surface: the reference and at least two other ribbons were there.
        surfaces_per_s: over the last interval.
        latency_p50_s, latency_p99_s: from the end of the oldest scan of a frame to the result in memory.
        age_p50_s: from the moment that a frame shows to the result in memory: the latency, and,
            two-sided, how old the readings are at the end of their scan.
        lambda_limited: transversals that were held at their smallest tangent.
        unsolved: frames that could not be reconstructed.
        dropped: scans that came faster than they could be reconstructed.
        scan_spread_p50_s: how far apart the scans of a frame ended, by the estimated clocks.
        error_mean_percent, ..._min_..., ..._max_...: E against the emulator's truth; NaN if there is none.
        cpu_percent: of one core, this process, emulator included.
    """

    frames: int
    surfaces: int
    surfaces_per_s: float
    latency_p50_s: float
    latency_p99_s: float
    age_p50_s: float
    lambda_limited: int
    unsolved: int
    dropped: int
    scan_spread_p50_s: float
    error_mean_percent: float
    error_min_percent: float
    error_max_percent: float
    cpu_percent: float

    def error_as_json(self) -> JsonObject | None:
        """E, or None if there is no truth to compare with."""
        if math.isnan(self.error_mean_percent):
            return None
        return {
            "mean": round(self.error_mean_percent, 4),
            "min": round(self.error_min_percent, 4),
            "max": round(self.error_max_percent, 4),
        }

    def latency_as_json(self) -> JsonObject:
        return {"p50": _ms(self.latency_p50_s), "p99": _ms(self.latency_p99_s)}

    def as_json(self) -> JsonObject:
        """The object that `stream --json` prints."""
        return {
            "frames": self.frames,
            "surfaces": self.surfaces,
            "surfaces_per_s": round(self.surfaces_per_s, 2),
            "latency_ms": self.latency_as_json(),
            "age_ms": _ms(self.age_p50_s),
            "lambda_limited": self.lambda_limited,
            "unsolved": self.unsolved,
            "dropped": self.dropped,
            "scan_spread_ms": _ms(self.scan_spread_p50_s),
            "error_percent": self.error_as_json(),
            "cpu_percent": round(self.cpu_percent, 1),
        }


@dataclass(frozen=True)
class Report:
    """A stream since it runs; t_s: for how long."""

    t_s: float
    rate_hz: int
    ribbons: tuple[RibbonReport, ...]
    comb: CombReport

    def as_json(self) -> JsonObject:
        """The object that `stream --json` prints once a second."""
        return {
            "report": {
                "t_s": round(self.t_s, 3),
                "ribbons": [ribbon.as_json() for ribbon in self.ribbons],
                "comb": self.comb.as_json(),
            }
        }

    def summary_as_json(self) -> JsonObject:
        """The object that `stream --json` prints last."""
        counters = [ribbon.counters for ribbon in self.ribbons]
        return {
            "summary": {
                "ribbons": sum(ribbon.state not in ("missing", "absent") for ribbon in self.ribbons),
                "rate_hz": self.rate_hz,
                "frames": sum(c.frames for c in counters),
                "lost": sum(c.lost for c in counters),
                "crc_errors": sum(c.crc_errors for c in counters),
                "invalid_nodes": sum(c.invalid_nodes for c in counters),
                "surfaces": self.comb.surfaces,
                "latency_ms": self.comb.latency_as_json(),
                "age_ms": _ms(self.comb.age_p50_s),
                "cpu_percent": round(self.comb.cpu_percent, 1),
                "error_percent": self.comb.error_as_json(),
            }
        }


def _ms(duration_s: float) -> float | None:
    return None if math.isnan(duration_s) else round(duration_s * 1e3, 3)
