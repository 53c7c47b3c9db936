"""The C tracker of one ribbon with its memory."""

from typing import Any

import numpy as np

from ribbonhost.motion.model import Float64, Motion, MotionParams, Samples, Status, motion_of
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
        self._last: tuple[Float64, Float64] | None = None
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
        c_samples = samples.to_c(self.params.node_count, self._force_change(samples))
        error = lib.ribbon_motion_run(
            self._tracker, len(samples), c_samples, self._steps + self.count, self._work
        )
        if error < 0:
            raise ValueError("samples must have increasing times")
        self.count += len(samples)

    def _force_change(self, samples: Samples) -> Float64:
        """(T, n) magnitude of the specific force's rate of change, from the sample before."""
        force, t_s = samples.force_mps2, samples.t_s
        before = self._last or (force[:1], t_s[:1] - 1.0)
        force, t_s = np.concatenate([before[0], force]), np.concatenate([before[1], t_s])
        if len(samples):
            self._last = force[-1:], t_s[-1:]
        with np.errstate(all="ignore"):  # values of sensors that are not valid may be anything
            return np.asarray(np.linalg.norm(np.diff(force, axis=0), axis=-1) / np.diff(t_s)[:, None])

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
        lib.ribbon_motion_step_outputs(self._model, last - first, self._steps + 1 + first, nodes, self._work)
        return self._motion(nodes, first, last)

    def smoothed(self, first: int, last: int) -> Motion:
        """The motion at the kept samples [first, last), each from all samples kept."""
        count = self.count - first
        known = min(count, last - first + COVARIANCE_AHEAD)
        states = ffi.new("struct ribbon_motion_state[]", count)
        covariances = _new_uncleared(
            f"double[][{lib.RIBBON_MOTION_MATRIX_MAX}][{lib.RIBBON_MOTION_MATRIX_MAX}]", known
        )
        steps = self._steps + 1 + first
        lib.ribbon_motion_smooth(self._model, count, steps, states, covariances, known, self._work)
        nodes = ffi.new("struct ribbon_motion_nodes[]", last - first)
        lib.ribbon_motion_outputs(self._model, last - first, states, covariances, nodes, self._work)
        return self._motion(nodes, first, last)

    def smoothed_mean(self, index: int) -> Motion:
        """The motion at a kept sample from all samples kept, with the covariance from those up to it."""
        count = self.count - index
        states = ffi.new("struct ribbon_motion_state[]", count)
        steps = self._steps + 1 + index
        lib.ribbon_motion_smooth(self._model, count, steps, states, ffi.NULL, 0, self._work)
        nodes = ffi.new("struct ribbon_motion_nodes *")
        if steps[0].status != Status.WAITING:
            lib.ribbon_motion_output(self._model, states, steps[0].covariance, nodes, self._work)
        return self._motion(nodes, index, index + 1)

    def _motion(self, nodes: Any, first: int, last: int) -> Motion:
        status = np.array([self._steps[1 + i].status for i in range(first, last)], np.int32)
        t_s: Float64 = np.array([self._steps[1 + i].state.t_s for i in range(first, last)])
        return motion_of(nodes, last - first, status, t_s, self.params.node_count)
