"""What a case of the motion benchmark comes to: errors of level reading, live and two-sided; coverage."""

import dataclasses
import time
from dataclasses import dataclass

import numpy as np

from ribbonhost.bench.motion_cases import Goal
from ribbonhost.bench.motion_chain import Recording, record
from ribbonhost.bench.motion_trouble import HOLE_S
from ribbonhost.bench.motion_truth import Bool, Float64, Truth
from ribbonhost.motion import LiveMotion, Motion, MotionParams, smooth_recording
from ribbonhost.reconstruct.ribbon import RibbonSolver

COUNTED_S = 1.0
"""From here on errors count; live estimates have settled."""

SHAKEN_COUNTED_S = 3.0
BACK_S = 0.5
LAG_SAMPLES = 20
LASTING_S = 0.5
LASTING_PERCENT = 1.0
COVERED_PERCENT = (93.0, 97.0)


@dataclass(frozen=True, eq=False)
class Result:
    """Errors E in percent of the length, (T,) each, and what follows from them.

    lagged: mean E of the live estimate with a lag of 0.2 s, NaN if not asked for.
    coverage: share in percent of true node positions inside the 95 % region, live and two-sided.
    worst_s: longest time for which the live error stayed above both the level reading's and 1 %.
    """

    goal: Goal
    t_s: Float64
    level: Float64
    live: Float64
    two_sided: Float64
    counted: Bool
    lagged: float
    coverage_live: float
    coverage_two_sided: float
    worst_s: float
    restarts: int
    live_s_per_sample: float
    two_sided_s_per_sample: float

    def mean(self, name: str) -> float:
        """Mean of "level", "live" or "two_sided" over what counts."""
        return float(np.nanmean(getattr(self, name)[self.counted]))

    def largest(self, name: str) -> float:
        """Largest of the same."""
        return float(np.nanmax(getattr(self, name)[self.counted]))

    def failures(self) -> list[str]:
        """What the case must reach and does not, in words."""
        goal, found = self.goal, []
        if goal.live is not None and not self.mean("live") <= goal.live:
            found.append(f"live {self.mean('live'):.3f} % > {goal.live} %")
        if goal.two_sided is not None and not self.mean("two_sided") <= goal.two_sided:
            found.append(f"two-sided {self.mean('two_sided'):.3f} % > {goal.two_sided} %")
        if goal.lagged is not None and not self.lagged <= goal.lagged:
            found.append(f"live with a lag of 0.2 s {self.lagged:.3f} % > {goal.lagged} %")
        if goal.never_worse_than_level:
            found += [
                f"{name} {self.mean(name):.4f} % worse than the level reading"
                for name in ("live", "two_sided")
                if not self.mean(name) <= self.mean("level")
            ]
        if goal.lasting and not self.worst_s <= LASTING_S:
            found.append(f"astray for {self.worst_s:.1f} s")
        if not (np.isfinite(self.live).all() and np.isfinite(self.two_sided).all()):
            found.append("NaN")
        return found


@dataclass(frozen=True)
class Coverage:
    """Share in percent of true node positions inside the 95 % region, over the cases that the model covers.

    A case is a few seconds, and what is left of an error lasts about as long: one case alone says little.
    """

    live: float
    two_sided: float

    def failures(self) -> list[str]:
        """What must be reached and is not, in words."""
        return [
            f"coverage {name} {share:.1f} %"
            for name, share in (("live", self.live), ("two-sided", self.two_sided))
            if not COVERED_PERCENT[0] <= share <= COVERED_PERCENT[1]
        ]


def coverage_of(results: list[Result]) -> Coverage | None:
    """None if the model covers none of the cases."""
    covered = [result for result in results if result.goal.covered]
    if not covered:
        return None
    return Coverage(
        live=float(np.mean([result.coverage_live for result in covered])),
        two_sided=float(np.mean([result.coverage_two_sided for result in covered])),
    )


def evaluate(goal: Goal) -> Result:
    """Runs a case. Raises SceneError for a scene that cannot be."""
    recording = record(goal.case)
    samples, truth = recording.samples, recording.truth
    params = recording.params
    started_s = time.process_time()
    estimator = LiveMotion(params)
    live = estimator.update(samples)
    live_s = time.process_time() - started_s
    assert live is not None
    started_s = time.process_time()
    two_sided = smooth_recording(samples, params)
    two_sided_s = time.process_time() - started_s
    counted = samples.t_s >= (SHAKEN_COUNTED_S if goal.case.anchor == "shaken" else COUNTED_S)
    if "lost frames" in goal.case.trouble:
        counted &= (samples.t_s < HOLE_S[0]) | (samples.t_s >= HOLE_S[1] + BACK_S)
    level_error = level_percent(recording)
    live_error = error_percent(live.position_m, truth, samples.t_s)
    return Result(
        goal=goal,
        t_s=samples.t_s,
        level=level_error,
        live=live_error,
        two_sided=error_percent(two_sided.position_m, truth, samples.t_s),
        counted=counted,
        lagged=lagged_percent(recording, params) if goal.lagged is not None else float("nan"),
        coverage_live=coverage_percent(live, truth, counted),
        coverage_two_sided=coverage_percent(two_sided, truth, counted),
        worst_s=longest_s(
            samples.t_s, (live_error > np.fmax(level_error, LASTING_PERCENT)) & (samples.t_s > 0.5)
        ),
        restarts=estimator.counters["restarts"],
        live_s_per_sample=live_s / len(samples),
        two_sided_s_per_sample=two_sided_s / len(samples),
    )


def error_percent(position_m: Float64, truth: Truth, t_s: Float64) -> Float64:
    """(T,) mean distance of the nodes from where they are, in percent of the length."""
    true_m = truth.at(truth.position_m, t_s)[:, 1::2]
    return np.asarray(100 * np.linalg.norm(position_m - true_m, axis=-1).mean(axis=1) / truth.length_m)


def lagged_percent(recording: Recording, params: MotionParams) -> float:
    """Mean E of the live estimate LAG_SAMPLES later than its samples."""
    motion = LiveMotion(params, lag_samples=LAG_SAMPLES).update(recording.samples)
    assert motion is not None
    error = error_percent(motion.position_m, recording.truth, motion.t_s)
    return float(error[motion.t_s >= COUNTED_S].mean())


def level_percent(recording: Recording) -> Float64:
    """(T,) the same for the level reading, at the age, from about none to 20 ms, that suits it best."""
    samples, truth = recording.samples, recording.truth
    solver = RibbonSolver(truth.pitch_m, samples.level_q.shape[1])
    there = samples.level_valid.any(axis=1)
    position_m = np.full((len(samples), samples.level_q.shape[1], 3), np.nan)
    q = np.where(samples.level_valid[..., None], samples.level_q, np.array([1.0, 0.0, 0.0, 0.0]))
    position_m[there] = solver.solve(q[there], samples.level_valid[there])
    candidates = [
        error_percent(position_m, truth, samples.t_s + ahead_s)
        for ahead_s in np.arange(-0.0045, 0.016, 0.005)
    ]
    return min(candidates, key=lambda error: float(np.nanmean(error)))


def coverage_percent(motion: Motion, truth: Truth, counted: Bool) -> float:
    """Share of true node positions within the 95 % radius."""
    true_m = truth.at(truth.position_m, motion.t_s)[:, 1::2]
    inside = np.linalg.norm(motion.position_m - true_m, axis=-1) <= motion.radius_95_m()
    return float(100 * inside[counted].mean())


def longest_s(t_s: Float64, bad: Bool) -> float:
    """The longest time without interruption for which `bad` holds."""
    longest, since = 0.0, None
    for time_s, is_bad in zip(t_s, bad, strict=True):
        since = (time_s if since is None else since) if is_bad else None
        longest = max(longest, time_s - since if since is not None else 0.0)
    return float(longest)


def as_json(result: Result) -> dict[str, object]:
    """The figures of a case."""
    return {
        "case": dataclasses.asdict(result.goal.case),
        "mean_percent": {name: round(result.mean(name), 5) for name in ("level", "live", "two_sided")},
        "max_percent": {name: round(result.largest(name), 4) for name in ("level", "live", "two_sided")},
        "lagged_mean_percent": None if np.isnan(result.lagged) else round(result.lagged, 5),
        "coverage_percent": {"live": result.coverage_live, "two_sided": result.coverage_two_sided},
        "astray_s": result.worst_s,
        "restarts": result.restarts,
        "failures": result.failures(),
    }
