"""Where the error of a comb comes from: each source alone, and all together."""

from dataclasses import replace
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ribbonhost import wire
from ribbonhost.bench import chain
from ribbonhost.bench.accuracy import LAYOUT, comb_errors
from ribbonhost.reconstruct import CombLayout, CombSolver
from ribbonhost.reconstruct.comb import METHODS

if TYPE_CHECKING:
    from ribbonhil.geodesics import Geodesics
    from ribbonhil.scenes import Scene

Float64 = NDArray[np.float64]

FRAMES = 40
NODE_COUNTS = (6, 8, 12, 16, 24, 32, 64, 128)
SKEWS_MS = (1.0, 5.0, 10.0)
PERIODS_S = (40.0, 20.0, 10.0, 5.0, 2.0)
STREAM_STEP = 20
"""Of a stream's frames, every so many are taken."""


def spacing_errors(scene: "Scene") -> dict[str, dict[str, float]]:
    """Mean E by number of nodes and method, exact orientations on ribbons of LAYOUT's length."""
    from ribbonhil.geodesics import trace

    t = np.arange(FRAMES) / FRAMES
    origin, east = np.zeros((FRAMES, 2)), np.broadcast_to([1.0, 0.0, 0.0], (FRAMES, 3))
    roots = trace(scene, t, origin, east, LAYOUT.pitch_m, 2 * LAYOUT.node_count)
    starts = np.rint(np.array(LAYOUT.start_m) / LAYOUT.pitch_m).astype(int)
    every_t = np.repeat(t[:, None], len(starts), axis=1)
    found: dict[str, dict[str, float]] = {}
    for nodes in NODE_COUNTS:
        pitch_m = LAYOUT.length_m / (2 * nodes - 1)
        # The geodesics are integrated in steps of their own points: not too wide ones.
        finer = int(np.ceil(pitch_m / LAYOUT.pitch_m))
        slots = slice(finer, None, 2 * finer)
        count = finer * (2 * nodes - 1) + 1
        reference = trace(scene, t, origin, east, pitch_m / finer, count)
        ribbons = trace(
            scene,
            every_t,
            roots.position_m[:, starts, :2],
            roots.binormal[:, starts],
            pitch_m / finer,
            count,
        )
        q = np.concatenate([_orient(reference, slots)[:, None], _orient(ribbons, slots)], axis=1)
        node_m = np.concatenate([reference.position_m[:, None], ribbons.position_m], axis=1)[:, :, slots]
        truth_m = node_m - reference.position_m[:, None, None, 0]
        layout = CombLayout(pitch_m, nodes, LAYOUT.start_m)
        found[str(nodes)] = {
            method: _mean(CombSolver(layout, method).solve_many(np.ascontiguousarray(q)).node_m, truth_m)  # type: ignore[arg-type]
            for method in METHODS
        }
    return found


def _orient(lines: "Geodesics", slots: slice) -> Float64:
    from ribbonhil.truth import quaternions

    axes = np.stack([lines.tangent, lines.binormal, lines.normal], axis=-1)
    return np.asarray(quaternions(axes[..., slots, :, :]))


def _mean(node_m: Float64, truth_m: Float64) -> float:
    return float(comb_errors(LAYOUT, node_m, truth_m).percent.mean())


def _solve(q: Float64, valid: NDArray[np.bool_] | None = None) -> Float64:
    return CombSolver(LAYOUT).solve_many(np.ascontiguousarray(q), valid).node_m


def level(up: Float64, field: Float64) -> Float64:
    """Orientations (..., 4) from the directions of up and of the field (..., 3) in the node frame."""
    from ribbonhil.truth import quaternions

    up = up / np.linalg.norm(up, axis=-1, keepdims=True)
    north = field - np.sum(field * up, axis=-1, keepdims=True) * up
    north /= np.linalg.norm(north, axis=-1, keepdims=True)
    # The rows of the rotation from node to world are the world's axes in the node frame.
    return np.asarray(quaternions(np.stack([np.cross(north, up), north, up], axis=-2)))


def gravity_at_nodes(gravity: Float64) -> Float64:
    """Gravity (..., slots, 3) at the accelerometers, interpolated to the nodes by the firmware's stencils."""
    from ribbonhil._firmware import ffi, lib

    accels = gravity[..., 0::2, :]
    count = accels.shape[-2]
    out = np.empty_like(accels)
    stencil = ffi.new("struct stencil *")
    valid = ffi.new("bool[]", [True] * count)
    for k in range(count):
        lib.stencil_make(stencil, 2.0 * k + 1.0, valid, count, count)
        used = range(stencil.count)
        out[..., k, :] = sum(stencil.weight[i] * accels[..., stencil.index[i], :] for i in used)
    return out


def quantised(q: Float64, compact: bool) -> Float64:
    """Orientations (..., n, 4) after the wire, in ORIENT or ORIENT_COMPACT."""
    n = q.shape[-2]
    valid, quality = np.ones(n, np.bool_), np.zeros(n, np.uint8)
    out = []
    for row in q.reshape(-1, n, 4):
        packet: wire.Orient | wire.OrientCompact
        if compact:
            packet = wire.OrientCompact(0, 0, wire.NodeCompactArray(row, valid, quality))
        else:
            packet = wire.Orient(0, 0, wire.NodeArray(row, valid, quality))
        decoded, _ = wire.decode(wire.encode(packet))
        assert isinstance(decoded, wire.Orient | wire.OrientCompact)
        out.append(decoded.nodes.q_world_node)
    return np.array(out).reshape(q.shape)


def multiply(a: Float64, b: Float64) -> Float64:
    """Hamilton product of quaternions (..., 4), scalar first."""
    aw, av, bw, bv = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    w = aw * bw - np.sum(av * bv, axis=-1, keepdims=True)
    return np.concatenate([w, aw * bv + bw * av + np.cross(av, bv)], axis=-1)


def conjugate(q: Float64) -> Float64:
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def sources(scene: "Scene", seed: int) -> dict[str, float]:
    """Mean E that each source causes on the default method, percent: what it moves the nodes by."""
    from ribbonhil.truth import Field, comb_truth

    truth = comb_truth(scene, chain.RIBBONS)
    slow = chain.moving(scene, 1.0, seed, accelerated=False)
    noisy, clean = chain.moving(scene, 1.0, seed), chain.moving(scene, 0.0, seed)
    t_s = reduce(np.intersect1d, (data.t_s for data in (slow, noisy, clean)))[::STREAM_STEP]
    slow, noisy, clean = (_at(data, t_s) for data in (slow, noisy, clean))
    truth_m = noisy.node_m
    q_slot = truth.q_world_slot(t_s)
    q = np.ascontiguousarray(q_slot[:, :, 1::2])
    exact_m = _solve(q)

    up = _world_in_node(q_slot, np.array([0.0, 0.0, 1.0]))
    field = _world_in_node(q_slot, Field().world_ut())
    both = noisy.valid & clean.valid
    noise = np.where(
        both[..., None], multiply(noisy.q_world_node, conjugate(clean.q_world_node)), [1.0, 0, 0, 0]
    )
    found = {
        "node spacing": _mean(exact_m, truth_m),
        "offset, sensors paired as if in one place": _mean(
            _solve(level(up[:, :, 0::2], field[:, :, 1::2])), exact_m
        ),
        "offset, gravity interpolated by the firmware": _mean(
            _solve(level(gravity_at_nodes(up), field[:, :, 1::2])), exact_m
        ),
        "noise of the parts after the firmware's filter": _mean(_solve(multiply(noise, q)), exact_m),
        "quantisation, ORIENT": _mean(_solve(quantised(q, compact=False)), exact_m),
        "quantisation, ORIENT_COMPACT": _mean(_solve(quantised(q, compact=True)), exact_m),
    }
    rng = np.random.default_rng(seed)
    for skew_ms in SKEWS_MS:
        late_s = 1e-3 * skew_ms * rng.uniform(-1, 1, (len(t_s), q.shape[1]))
        skewed = np.stack(
            [truth.q_world_slot(t_s + late_s[:, r])[:, r, 1::2] for r in range(q.shape[1])], axis=1
        )
        found[f"ribbons sampled up to {skew_ms:g} ms apart"] = _mean(_solve(skewed), exact_m)
    found["together, without motion"] = _mean(_solve(slow.q_world_node, slow.valid), truth_m)
    found["motion, read as a level"] = motion_error(scene, scene.period_s)
    found["together"] = _mean(_solve(noisy.q_world_node, noisy.valid), truth_m)
    return found


def _at(data: chain.Orientations, t_s: Float64) -> chain.Orientations:
    rows = np.searchsorted(data.t_s, t_s)
    return chain.Orientations(
        data.t_s[rows],
        np.ascontiguousarray(data.q_world_node[rows]),
        np.ascontiguousarray(data.valid[rows]),
        data.sigma_rad[rows],
        data.node_m[rows],
    )


def _world_in_node(q: Float64, v: Float64) -> Float64:
    """A vector of the world in the frames of nodes with orientations q (..., 4): (..., 3)."""
    pure = np.concatenate([np.zeros(1), v])
    return multiply(multiply(conjugate(q), np.broadcast_to(pure, q.shape)), q)[..., 1:]


def motion_error(scene: "Scene", period_s: float) -> float:
    """Mean E of reading the specific force of a moving comb as a level, sensors at every node, percent."""
    from ribbonhil.truth import comb_truth

    truth = comb_truth(replace(scene, period_s=period_s), chain.RIBBONS)
    rows = slice(None, None, max(1, len(truth.position_m) // FRAMES))
    nodes = slice(1, None, 2)
    moved = level(truth.specific_force_mps2[rows, :, nodes], truth.field_ut[rows, :, nodes])
    still = np.asarray(level(truth.r_world_node[rows, :, nodes, 2], truth.field_ut[rows, :, nodes]))
    return _mean(_solve(moved), _solve(still))


def measure_budget(scenes: tuple[str, ...], seed: int) -> dict[str, Any]:
    """Of each scene: E by number of nodes, by source, by period of the motion, percent."""
    found = {}
    for name in scenes:
        scene = chain.load(name)
        found[name] = {
            "spacing": spacing_errors(scene),
            "sources": sources(scene, seed),
            "motion": {f"{period_s:g}": motion_error(scene, period_s) for period_s in PERIODS_S},
        }
    return found
