"""Combs on the scenes of the emulator, exact, and random smooth ones, for the tests of this folder."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from ribbonhil.geodesics import Geodesics, trace
from ribbonhil.scenes import BUILTIN
from ribbonhost.reconstruct import CombLayout
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
LAYOUT = CombLayout(pitch_m=0.025, node_count=16, start_m=(0.0, 0.15, 0.30, 0.45, 0.60))


@dataclass(frozen=True)
class TrueComb:
    """q_world_node: (phases, R + 1, n, 4); anchor_m: (phases, R + 1, 3); node_m: (phases, R + 1, n, 3)."""

    q_world_node: Array
    anchor_m: Array
    node_m: Array


def reference_and_ribbons(
    scene: str, phases: int, pitch_m: float, count: int, starts: list[int]
) -> tuple[Geodesics, Geodesics]:
    """Reference (phases, count) from the origin toward +x, ribbons (phases, R, count) orthogonal to it."""
    t = np.arange(phases) / phases
    reference = trace(
        BUILTIN[scene], t, np.zeros((phases, 2)), np.broadcast_to([1.0, 0, 0], (phases, 3)), pitch_m, count
    )
    every_t = np.repeat(t[:, None], len(starts), axis=1)
    ribbons = trace(
        BUILTIN[scene],
        every_t,
        reference.position_m[:, starts, :2],
        reference.binormal[:, starts],
        pitch_m,
        count,
    )
    return reference, ribbons


def quaternions(lines: Geodesics, nodes: slice) -> Array:
    frames = np.stack([lines.tangent, lines.binormal, lines.normal], axis=-1)[..., nodes, :, :]
    xyzw = Rotation.from_matrix(frames.reshape(-1, 3, 3)).as_quat()
    return xyzw[:, [3, 0, 1, 2]].reshape(*frames.shape[:-2], 4)


def true_comb(scene: str, phases: int = 8) -> TrueComb:
    """The comb of LAYOUT on a scene, origin at the reference's anchor."""
    starts = [round(s / LAYOUT.pitch_m) for s in LAYOUT.start_m]
    lines = reference_and_ribbons(scene, phases, LAYOUT.pitch_m, 2 * LAYOUT.node_count, starts)
    reference, ribbons = lines
    nodes = slice(1, None, 2)
    q = np.concatenate([quaternions(reference, nodes)[:, None], quaternions(ribbons, nodes)], axis=1)
    position = np.concatenate([reference.position_m[:, None], ribbons.position_m], axis=1)
    position = position - reference.position_m[:, None, None, 0]
    return TrueComb(np.ascontiguousarray(q), position[:, :, 0], np.ascontiguousarray(position[:, :, nodes]))


def random_directions(rng: np.random.Generator, *shape: int) -> Array:
    v = rng.normal(size=(*shape, 3))
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def random_ribbon(rng: np.random.Generator, n: int, turn_rad: float) -> Array:
    """Orientations (n, 4) that turn by random angles of about `turn_rad` from node to node, random signs."""
    steps = Rotation.from_rotvec(rng.normal(size=(n, 3)) * turn_rad)
    at = Rotation.random(rng=rng)
    q = np.empty((n, 4))
    for k in range(n):
        at = at * steps[k]
        q[k] = at.as_quat()[[3, 0, 1, 2]] * rng.choice([-1.0, 1.0])
    return q
