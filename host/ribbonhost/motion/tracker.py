"""The C tracker of one ribbon with its memory."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ribbonhost.motion.model import Float64, Motion, MotionParams, Samples, Status, motion_of
from ribbonhost.motion.sharing import Helpers
from ribbonhost.native._native import ffi, lib

COVARIANCE_AHEAD = 40
"""Samples that a smoothed covariance looks ahead: after so many it hardly changes."""

_new_uncleared = ffi.new_allocator(should_clear_after_alloc=False)


class Tracker:
    """Follows one ribbon and keeps what each of the newest samples left. Not for several threads at once."""

    def __init__(self, params: MotionParams, capacity: int) -> None:
        """`capacity`: samples of which the steps are kept.

        Raises ValueError for parameters that cannot be.
        """
        self.params = params
        self.capacity = capacity
        self.count = 0
        self._last: tuple[Float64, float] | None = None
        self._tracker = ffi.new("struct ribbon_motion_tracker *")
        error = lib.ribbon_motion_tracker_init(self._tracker, params.to_c())
        if error == lib.RIBBON_MOTION_ERROR_COUNT:
            raise ValueError(
                f"the motion estimator takes {lib.RIBBON_MOTION_NODE_MIN} to "
                f"{lib.RIBBON_MOTION_NODE_MAX} nodes, not {params.node_count}"
            )
        if error < 0:
            raise ValueError(
                "parameters of the motion estimator are finite and positive, field_axes is 2 or 3"
            )
        self._model = ffi.addressof(self._tracker, "model")
        # A step is large, and its status says whether it holds anything.
        self._steps = _new_uncleared("struct ribbon_motion_step[]", capacity + 1)
        self._steps[0].status = Status.WAITING
        self._work_memory = ffi.new("double[]", lib.ribbon_motion_work_bytes() // 8 + 1)
        self._work = ffi.cast("struct ribbon_motion_work *", self._work_memory)

    @property
    def counters(self) -> dict[str, int]:
        """Samples taken; how often it started again; outliers among the sensors; samples refused."""
        return {
            name: int(getattr(self._tracker, name))
            for name in ("samples", "restarts", "outliers", "rejected")
        }

    @property
    def scales(self) -> dict[str, float]:
        """Variances found from the samples, in units of the parameters': sensors' noise, jerk, anchor."""
        scales = self._tracker.scales
        jerks = dict(zip(("root_x", "root_y", "root_z", "twist", "bend"), scales.jerk, strict=True))
        return {
            name: float(value)
            for name, value in {
                "force_noise": scales.force_noise,
                "field_noise": scales.field_noise,
                "force_offset": scales.force_offset,
                **{f"{name}_jerk": value for name, value in jerks.items()},
                "anchor": scales.anchor,
            }.items()
        }

    def extend(self, samples: Samples) -> None:
        """Takes further samples, later and later; there must be room for them."""
        if self.count + len(samples) > self.capacity:
            raise ValueError(f"{len(samples)} samples are more than there is room for")
        if len(samples) == 0:
            return
        force_mps2, t_s = self._before(samples, 0)
        change = _force_change_mps3(
            samples,
            np.concatenate([force_mps2[None], samples.force_mps2[:-1]]),
            np.concatenate([[t_s], samples.t_s[:-1]]),
        )
        self._run(samples.to_c(self.params.node_count, change), len(samples))
        self._last = samples.force_mps2[-1], float(samples.t_s[-1])

    def _before(self, samples: Samples, row: int) -> tuple[Float64, float]:
        """(n, 3) specific force of the sample before the next, which is in a row; its time."""
        return self._last or (samples.force_mps2[row], float(samples.t_s[row]) - 1.0)

    def _run(self, c_samples: Any, count: int) -> None:
        if lib.ribbon_motion_run(self._tracker, count, c_samples, self._steps + self.count, self._work) < 0:
            raise ValueError("samples must have increasing times")
        self.count += count

    def rewind(self) -> None:
        """Begins again, with what has been learnt of the sensors and of the motion."""
        lib.ribbon_motion_tracker_rewind(self._tracker)
        self._steps[0].status = Status.WAITING
        self._last = None
        self.count = 0

    def forget(self, count: int) -> None:
        """Drops the steps of the oldest `count` samples."""
        size = ffi.sizeof("struct ribbon_motion_step")
        ffi.memmove(self._steps, self._steps + count, (self.count - count + 1) * size)
        self.count -= count

    def filtered(self, first: int, last: int) -> Motion:
        """The motion at the kept samples [first, last), each from the samples up to it."""
        nodes = ffi.new("struct ribbon_motion_nodes[]", last - first)
        self._output(first, last, nodes)
        return self._motion(nodes, first, last)

    def _output(self, first: int, last: int, nodes: Any) -> None:
        lib.ribbon_motion_step_outputs(self._model, last - first, self._steps + 1 + first, nodes, self._work)

    def _output_at(self, c_sample: Any, nodes: Any) -> None:
        """The motion at the time of a sample that has not been taken, from the newest that was."""
        step = self._steps + self.count
        if step.status == Status.WAITING:
            return
        if lib.ribbon_motion_advance(
            self._model, c_sample, ffi.addressof(self._tracker, "scales"), step, step
        ):
            self._output(self.count - 1, self.count, nodes)  # it is no later
            return
        lib.ribbon_motion_output(
            self._model, ffi.addressof(step, "predicted"), step.predicted_covariance, nodes, self._work
        )

    def smoothed(self, first: int, last: int) -> Motion:
        """The motion at the kept samples [first, last), each from all samples kept."""
        count = self.count - first
        states = ffi.new("struct ribbon_motion_state[]", count)
        nodes = ffi.new("struct ribbon_motion_nodes[]", last - first)
        steps = self._steps + 1 + first
        lib.ribbon_motion_smooth(
            self._model, count, steps, states, nodes, last - first, COVARIANCE_AHEAD, self._work
        )
        return self._motion(nodes, first, last)

    def smoothed_mean(self, index: int) -> Motion:
        """The motion at a kept sample from all samples kept, with the covariance from those up to it."""
        count = self.count - index
        states = ffi.new("struct ribbon_motion_state[]", count)
        steps = self._steps + 1 + index
        lib.ribbon_motion_smooth(self._model, count, steps, states, ffi.NULL, 0, 0, self._work)
        nodes = ffi.new("struct ribbon_motion_nodes *")
        if steps[0].status != Status.WAITING:
            lib.ribbon_motion_output(self._model, states, steps[0].covariance, nodes, self._work)
        return self._motion(nodes, index, index + 1)

    def _motion(self, nodes: Any, first: int, last: int) -> Motion:
        status = np.array([self._steps[1 + i].status for i in range(first, last)], np.int32)
        t_s: Float64 = np.array([self._steps[1 + i].state.t_s for i in range(first, last)])
        return motion_of(nodes, last - first, status, t_s, self.params.node_count)


def follow_each(trackers: Sequence[Tracker], samples: Samples, ahead_s: Float64, helpers: Helpers) -> Motion:
    """The motion of each of several ribbons of as many nodes, so much later than its next sample.

    Row i is of trackers[i]. ahead_s: (R,) not negative. The trackers must keep no samples, and do not keep
    these. The C library works without the interpreter's lock. Raises ValueError for arrays that cannot be,
    and for a time that is not later than that of the sample before.
    """
    count, node_count = len(trackers), trackers[0].params.node_count
    before = [tracker._before(samples, row) for row, tracker in enumerate(trackers)]
    change = _force_change_mps3(
        samples, np.array([force_mps2 for force_mps2, _ in before]), np.array([t_s for _, t_s in before])
    )
    c_samples = samples.to_c(node_count, change)
    nodes = ffi.new("struct ribbon_motion_nodes[]", count)
    status = np.zeros(count, np.int32)

    def follow(row: int) -> None:
        tracker = trackers[row]
        tracker._run(c_samples + row, 1)
        c_samples[row].t_s += ahead_s[row]
        tracker._output_at(c_samples + row, nodes + row)
        tracker._last = samples.force_mps2[row], float(samples.t_s[row])
        status[row] = tracker._steps[1].status
        tracker.forget(1)

    helpers.share(follow, count)
    return motion_of(nodes, count, status, samples.t_s + ahead_s, node_count)


def _force_change_mps3(samples: Samples, force_mps2: Float64, t_s: Float64) -> Float64:
    """(T, n) magnitude of the specific force's rate of change since earlier ones (T, n, 3) at times (T,)."""
    with np.errstate(all="ignore"):  # values of sensors that are not valid may be anything
        change = samples.force_mps2 - force_mps2
        return np.asarray(np.sqrt(np.einsum("tni,tni->tn", change, change)) / (samples.t_s - t_s)[:, None])
