"""How fast the motion estimator is: live, two-sided, and against its NumPy reference."""

import time
from dataclasses import dataclass

import numpy as np

from ribbonhost.bench.motion_chain import RATE_HZ
from ribbonhost.bench.motion_results import Result
from ribbonhost.motion import LiveMotion, MotionParams, Samples

RIBBONS = 6
LIVE_LIMIT_PERCENT = 60.0


@dataclass(frozen=True)
class Speed:
    """Of RIBBONS ribbons at RATE_HZ on one core.

    live_percent: of the core. two_sided_times_real_time: seconds of recording a second.
    times_reference: how many times faster a sample is than in the NumPy reference.
    """

    live_percent: float
    two_sided_times_real_time: float
    times_reference: float

    def failures(self) -> list[str]:
        """What must be reached and is not, in words."""
        found = []
        if not self.live_percent <= LIVE_LIMIT_PERCENT:
            found.append(f"live takes {self.live_percent:.0f} % of a core > {LIVE_LIMIT_PERCENT:.0f} %")
        if not self.two_sided_times_real_time >= 1.0:
            found.append(f"two-sided runs at {self.two_sided_times_real_time:.2f} of real time < 1")
        return found


def speed_of(results: list[Result]) -> Speed:
    """From the processor time of cases that were run; the reference is timed on one sample."""
    live_s = float(np.median([result.live_s_per_sample for result in results]))
    two_sided_s = float(np.median([result.two_sided_s_per_sample for result in results]))
    return Speed(
        live_percent=100 * RIBBONS * RATE_HZ * live_s,
        two_sided_times_real_time=1 / (RIBBONS * RATE_HZ * two_sided_s),
        times_reference=reference_s() / live_s,
    )


def still_samples(count: int) -> Samples:
    """A straight ribbon that lies still, with the noise of the parts."""
    from ribbonhost.motion.reference import Reference, State

    params = MotionParams()
    reference = Reference(params)
    n = params.node_count
    x = np.zeros(reference.states)
    x[-1] = params.gravity_mps2
    read = reference.predict_sensors(State(np.eye(3), x, np.zeros(3)))
    random = np.random.default_rng(0)
    there = np.ones((count, n), np.bool_)
    field_ut = np.zeros((count, n, 3))
    field_ut[..., :2] = read[3 * n :].reshape(n, 2) + params.field_sigma_ut * random.normal(
        size=(count, n, 2)
    )
    return Samples(
        t_s=np.arange(count) / RATE_HZ,
        force_mps2=read[: 3 * n].reshape(n, 3) + params.accel_sigma_mps2 * random.normal(size=(count, n, 3)),
        field_ut=field_ut,
        force_valid=there,
        field_valid=there,
        level_q=np.tile([1.0, 0.0, 0.0, 0.0], (count, n, 1)),
        level_valid=there,
        level_still=np.ones(count, np.bool_),
        anchor_mps2=np.zeros((count, 3)),
    )


def native_s(count: int = 200) -> float:
    """Processor time of one live sample of one ribbon."""
    samples, estimator = still_samples(count), LiveMotion(MotionParams())
    started_s = time.process_time()
    estimator.update(samples)
    return (time.process_time() - started_s) / count


def reference_s() -> float:
    """The same in the NumPy reference."""
    from ribbonhost.motion.reference import Reference, State

    reference, samples = Reference(MotionParams()), still_samples(1)
    x = np.zeros(reference.states)
    x[-1] = reference.params.gravity_mps2
    state, covariance = State(np.eye(3), x, np.zeros(3)), 1e-4 * np.eye(reference.states)
    started_s = time.process_time()
    covariance = reference.advance_covariance(state, covariance, 0.01, np.zeros(3), np.ones(5), 1.0, 1.0)
    reference.correct(reference.advance(state, 0.01, np.zeros(3)), covariance, samples, 0)
    return time.process_time() - started_s
