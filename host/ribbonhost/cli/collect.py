"""The frames of a recording as arrays: what `export` and `validate` work on."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ribbonhost.cli.progress import Progress, progress_bar
from ribbonhost.cli.recording_options import PartOptions
from ribbonhost.cli.replay import checked_method, checked_motion, later_calibrations, open_recordings
from ribbonhost.errors import RecordingError, UsageError
from ribbonhost.export.animation import Animation, NodeMotion, surface_grid
from ribbonhost.motion.model import radius_95_m
from ribbonhost.pipeline.poses import MotionMode
from ribbonhost.pipeline.readings import NO_CALIBRATIONS, Calibrations
from ribbonhost.pipeline.replay import Replay
from ribbonhost.pipeline.solving import Solved
from ribbonhost.reconstruct.comb import Method
from ribbonhost.record import Recording


class _Nearest:
    """Passes on the frames that are nearest to an even clock, as they come; all if there is no clock."""

    def __init__(self, rate_hz: float | None, keep: Callable[[float, Solved], None]) -> None:
        self._rate_hz = rate_hz
        self._keep = keep
        self._first_s = 0.0
        self._tick = 0
        self._before: tuple[float, Solved] | None = None
        self._kept_before = False

    def add(self, t_s: float, solved: Solved) -> None:
        if self._rate_hz is None:
            self._keep(t_s, solved)
            return
        if self._before is None:
            self._first_s = t_s
        keeps = False
        while t_s >= (due_s := self._first_s + self._tick / self._rate_hz):
            self._tick += 1
            if self._before and due_s - self._before[0] < t_s - due_s:
                if not self._kept_before:
                    self._keep(*self._before)
                    self._kept_before = True
            else:
                keeps = True
        if keeps:
            self._keep(t_s, solved)
        self._before, self._kept_before = (t_s, solved), keeps


class _Frames:
    """Frames of a comb, or of ribbons that belong to none: then one at each scan of the first."""

    def __init__(self, ribbons: int, with_surface: bool) -> None:
        self.t_s: list[float] = []
        self.node_m: list[NDArray[np.float64]] = []
        self.q_world_node: list[NDArray[np.float64]] = []
        self.valid: list[NDArray[np.bool_]] = []
        self.surface_m: list[NDArray[np.float32]] = []
        self.motion: list[tuple[NDArray[np.float64], ...] | None] = []
        self._with_surface = with_surface
        self._latest: list[Solved | None] = [None] * ribbons

    def see(self, solved: Solved) -> bool:
        """Whether it makes a frame; if so `keep` may be called before the next."""
        if solved.comb:
            return True
        self._latest[solved.places[0]] = solved
        return solved.places[0] == 0 and all(self._latest)

    def keep(self, t_s: float, solved: Solved) -> None:
        parts = [solved] if solved.comb else [part for part in self._latest if part]
        self.t_s.append(t_s)
        self.node_m.append(np.concatenate([part.node_m for part in parts]))
        self.q_world_node.append(np.concatenate([part.match.q_world_node for part in parts]))
        self.valid.append(np.concatenate([part.match.valid for part in parts]))
        self.motion.append(self._motion(parts))
        if solved.comb and self._with_surface:
            self.surface_m.append(surface_grid(solved.comb.vertices_m))

    @staticmethod
    def _motion(parts: Sequence[Solved]) -> tuple[NDArray[np.float64], ...] | None:
        """The arrays of NodeMotion in this frame; None if nothing in it was estimated."""
        if not any(part.motion for part in parts):
            return None
        rows = []
        for part in parts:
            vectors, scalars = np.full((2, *part.node_m.shape), np.nan), part.match.sigma_rad
            if part.motion:
                vectors[0], vectors[1] = part.motion.velocity_mps, part.motion.acceleration_mps2
                radius = radius_95_m(part.motion.position_covariance_m2)
            else:
                radius = np.full(scalars.shape, np.nan)
            rows.append((vectors[0], vectors[1], scalars, radius))
        return tuple(np.concatenate(arrays) for arrays in zip(*rows, strict=True))

    def node_motion(self) -> NodeMotion | None:
        """Of all frames; None if nothing was estimated in any."""
        there = [arrays for arrays in self.motion if arrays]
        if not there:
            return None
        empty = tuple(np.full(array.shape, np.nan) for array in there[0])
        return NodeMotion(
            *(np.stack(arrays) for arrays in zip(*(m or empty for m in self.motion), strict=True))
        )


def collect(
    recordings: Sequence[Recording],
    progress: Progress,
    *,
    method: Method | None = None,
    motion: MotionMode | None = None,
    calibrations: Calibrations = NO_CALIBRATIONS,
    start_s: float | None = None,
    end_s: float | None = None,
    rate_hz: float | None = None,
    with_surface: bool = True,
) -> tuple[Animation, Replay]:
    """Reconstructs a recording from start_s to end_s, seconds of the recording, as it was live.

    Frames before 0, when not all ribbons delivered, are left out. rate_hz: keep the frames nearest to an even
    clock. Also the replay that made them. Raises RecordingError if there is nothing, UsageError if nothing is
    between the times or ribbons without a comb are not alike.
    """
    low_s = max(0.0, start_s or 0.0)
    high_s = np.inf if end_s is None else end_s

    def on_solved(solved: Solved) -> None:
        t_s = solved.match.t_host_s - replay.t_zero_s
        if frames.see(solved) and low_s <= t_s <= high_s:
            nearest.add(t_s, solved)

    replay = Replay(
        recordings,
        method=method,
        motion=motion,
        calibrations=calibrations,
        on_progress=progress,
        on_solved=[on_solved],
    )
    places = replay.arrangement.places
    if len({place.node_count for place in places if place.node_count}) > 1:
        raise UsageError("ribbons of different lengths that make no comb do not fit into one file")
    frames = _Frames(len(places), with_surface)
    nearest = _Nearest(rate_hz, frames.keep)
    for count, t_s in enumerate(replay.play()):
        if t_s > high_s + 1.0:
            break
        if count % 500 == 0:
            progress(sum(recording.share for recording in recordings) / len(recordings))
    if not frames.t_s:
        if low_s > 0 or end_s is not None:
            raise UsageError(
                f"no frame lies between {low_s:g} and {high_s:g} s: the recording ends at {replay.t_s:.1f} s"
            )
        raise RecordingError(f"{recordings[0].path} holds nothing that can be reconstructed")
    t = np.array(frames.t_s)
    surface = np.stack(frames.surface_m) if frames.surface_m else np.zeros((len(t), 0, 0, 3), np.float32)
    return (
        Animation(
            t_s=t,
            node_m=np.stack(frames.node_m),
            q_world_node=np.stack(frames.q_world_node),
            valid=np.stack(frames.valid),
            names=tuple(place.label for place in places),
            surface_m=surface,
            motion=frames.node_motion(),
        ),
        replay,
    )


def reconstructed(
    paths: Sequence[Path], options: PartOptions, *, rate_hz: float | None = None, with_surface: bool = False
) -> tuple[Animation, Replay]:
    """The part of a recording that was asked for, with a progress bar; see `collect`.

    Raises what `collect` does, and UsageError for options that cannot be meant.
    """
    method, motion = checked_method(options.method), checked_motion(options.motion)
    recordings = open_recordings(paths)
    with progress_bar("reconstruct") as progress:
        return collect(
            recordings,
            progress,
            method=method,
            motion=motion,
            calibrations=later_calibrations(options.calibration or (), recordings[-1], motion),
            start_s=options.start_s,
            end_s=options.end_s,
            rate_hz=rate_hz,
            with_surface=with_surface,
        )
