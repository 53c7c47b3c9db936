"""A comb in motion, through firmware, wire and host: the ribbons' anchors move with the reference."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ribbonhost.bench.motion_chain import START_UP_S, collect, run_ribbon
from ribbonhost.bench.motion_truth import RIBBONS, Bool, Float64
from ribbonhost.motion import LiveMotion, Motion, Samples, smooth_recording
from ribbonhost.reconstruct import CombLayout, CombSolver, error_percent

LIMIT_PERCENT = 0.12
COUNTED_S = 1.0

Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True)
class CombResult:
    """Mean E of the comb's ribbons in percent of the length."""

    scene: str
    period_s: float
    level: float
    live: float
    two_sided: float

    def failures(self) -> list[str]:
        """What the comb must reach and does not, in words."""
        return [] if self.live <= LIMIT_PERCENT else [f"comb live {self.live:.3f} % > {LIMIT_PERCENT} %"]


def evaluate_comb(
    scene: str = "wing", period_s: float = 2.0, seconds: float = 6.0, seed: int = 0, axes: int = 2
) -> CombResult:
    """Runs RIBBONS ribbons and their reference. Raises SceneError for a scene that cannot be.

    axes: of the magnetometers.
    """
    from ribbonhil.ribbon import Device, EmulatedRibbon
    from ribbonhil.scenes import load_scene
    from ribbonhil.truth import comb_truth

    truth = comb_truth(load_scene(scene, period_s), RIBBONS)
    collected = [
        collect(
            run_ribbon(
                EmulatedRibbon.from_truth(truth.ribbon(index), Device(seed=seed + index)),
                START_UP_S + seconds,
            )
        )
        for index in range(RIBBONS + 1)
    ]
    recorded = [samples for samples, _ in collected]
    params = dataclasses.replace(collected[0][1], field_axes=axes)
    t_s = recorded[0].t_s
    counted = t_s >= COUNTED_S
    true_m = truth.node_from_anchor_m(t_s + START_UP_S)
    layout = CombLayout(truth.pitch_m, params.node_count, truth.start_m)
    solver = CombSolver(layout)

    def comb_error(q: Float64, valid: Bool) -> float:
        frames = [
            solver.solve(np.ascontiguousarray(q[:, i]), np.ascontiguousarray(valid[:, i]))
            for i in np.flatnonzero(counted)
        ]
        node_m = np.array([frame.node_m[1:] for frame in frames])
        return error_percent(node_m, true_m[counted, 1:], layout.length_m)

    def motion_error(estimate: Callable[[Samples], Motion]) -> float:
        motions = [estimate(recorded[0])]
        for start_m, samples in zip(truth.start_m, recorded[1:], strict=True):
            known = anchor_acceleration(motions[0], start_m, truth.pitch_m, samples.t_s)
            motions.append(estimate(dataclasses.replace(samples, anchor_mps2=known)))
        q = np.array([nearest(motion.q_world_node, motion.t_s, t_s) for motion in motions])
        return comb_error(q, np.isfinite(q).all(axis=-1))

    def live(samples: Samples) -> Motion:
        motion = LiveMotion(params).update(samples)
        assert motion is not None
        return motion

    return CombResult(
        scene=scene,
        period_s=period_s,
        level=comb_error(
            np.array([nearest(samples.level_q, samples.t_s, t_s) for samples in recorded]),
            np.array([nearest(samples.level_valid, samples.t_s, t_s) for samples in recorded]),
        ),
        live=motion_error(live),
        two_sided=motion_error(lambda samples: smooth_recording(samples, params)),
    )


def anchor_acceleration(reference: Motion, start_m: float, pitch_m: float, t_s: Float64) -> Float64:
    """(T, 3) acceleration of the place on the reference at which a ribbon starts, as known at times."""
    nodes = reference.acceleration_mps2.shape[1]
    s_m = np.concatenate([[0.0], pitch_m * np.arange(1, 2 * nodes, 2)])
    along = np.concatenate([np.zeros((len(reference.t_s), 1, 3)), reference.acceleration_mps2], axis=1)
    right = int(np.clip(np.searchsorted(s_m, start_m), 1, nodes))
    u = (start_m - s_m[right - 1]) / (s_m[right] - s_m[right - 1])
    there = along[:, right - 1] * (1 - u) + along[:, right] * u
    newest = np.clip(np.searchsorted(reference.t_s, t_s, side="right") - 1, 0, len(reference.t_s) - 1)
    return np.asarray(np.nan_to_num(there[newest]))


def nearest(values: NDArray[Scalar], from_s: Float64, to_s: Float64) -> NDArray[Scalar]:
    """Values (T, ...) at the times (U,) nearest to those they are for."""
    place = np.clip(np.searchsorted(from_s, to_s), 1, len(from_s) - 1)
    place -= to_s - from_s[place - 1] < from_s[place] - to_s
    return values[place]
