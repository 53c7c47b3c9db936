"""Times of frames, batches and threads on this machine, each in one run with what it is compared with."""

import os
import platform
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ribbonhost.bench import motion_speed
from ribbonhost.native._native import lib
from ribbonhost.reconstruct import CombLayout, CombSolver, curve_points, node_arc_lengths, reference
from ribbonhost.reconstruct.arguments import doubles

Float64 = NDArray[np.float64]

NODES = 16
BATCH_FRAMES = 100_000
LAYOUT = CombLayout(0.025, NODES, (0.0, 0.15, 0.30, 0.45, 0.60))


def fastest_s(
    work: Callable[[], object], seconds: float = 0.5, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Shortest time of a call, of at least three and as many as there is time for.

    clock: of the wall for calls so short that one of them goes uninterrupted on any machine; the clock of a
    thread (time.thread_time) errs by microseconds, and is for calls of milliseconds.
    """
    best, calls, end = np.inf, 0, time.perf_counter() + seconds
    while calls < 3 or time.perf_counter() < end:
        start = clock()
        work()
        best = min(best, clock() - start)
        calls += 1
    return best


def tangents(frames: int, nodes: int = NODES, turn_rad: float = 0.1) -> Float64:
    """Smooth tangents (frames, nodes, 3) that turn by about turn_rad from node to node."""
    rng = np.random.default_rng(1)
    phase = rng.uniform(0, 2 * np.pi, (frames, 2, 1))
    k = np.arange(nodes) * turn_rad
    azimuth, elevation = np.sin(k + phase[:, 0]), 0.7 * np.sin(1.3 * k + phase[:, 1])
    return np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    )


def orientations(frames: int, ribbons: int, nodes: int) -> Float64:
    """q (frames, ribbons + 1, nodes, 4) of a gently bent comb: reference along x, ribbons along y."""
    q = np.zeros((frames, ribbons + 1, nodes, 4))
    bend = 0.02 * np.sin(
        np.arange(nodes) + np.arange(ribbons + 1)[:, None] + np.arange(frames)[:, None, None]
    )
    quarter = np.where(np.arange(ribbons + 1) == 0, 0.0, np.pi / 4)[:, None]
    # A turn about the ribbon's binormal, then one about z that lays the ribbon in its direction.
    q[..., 0], q[..., 3] = np.cos(quarter) * np.cos(bend), np.sin(quarter) * np.cos(bend)
    q[..., 1], q[..., 2] = -np.sin(quarter) * np.sin(bend), np.cos(quarter) * np.sin(bend)
    return q


def update_s(method: str, frames: int = 256, nodes: int = NODES) -> float:
    """Time of one ribbon's frame, tangents to positions, in a batch that fits the cache: C alone."""
    s, t = node_arc_lengths(0.025, nodes), tangents(frames, nodes)
    position, shape = np.empty((2, frames, nodes + 1, 3))
    workspace = np.empty(5 * nodes)
    common = frames, nodes, doubles(s), doubles(t), doubles(position), doubles(shape)
    work = {
        "hermite": lambda: lib.ribbon_hermite_update(*common),
        "spline": lambda: lib.ribbon_spline_update(*common, doubles(workspace)),
        "spherical": lambda: lib.ribbon_spherical_update(*common, doubles(workspace)),
    }
    return fastest_s(work[method]) / frames


def slsqp_s(frames: int = 3) -> float:
    """Time of one frame by the paper's own minimisation of each segment, started from the frame before."""
    from scipy.optimize import minimize

    t = tangents(frames + 1)
    h = 0.05
    chord = [h * (t0 + t1) / 2 for t0, t1 in pairwise(t[0])]
    spent = []
    for frame in range(1, frames + 1):
        start = time.thread_time()
        for k in range(NODES - 1):
            t0, t1 = t[frame, k], t[frame, k + 1]

            def energy(d: Float64, t0: Float64, t1: Float64) -> float:
                return float(12 / h**3 * np.sum((d - h * (t0 + t1) / 2) ** 2))

            def too_long(d: Float64, t0: Float64, t1: Float64) -> float:
                return reference.segment_length(np.zeros(3), d, t0, t1, h) - h

            constraint = {"type": "eq", "fun": too_long, "args": (t0, t1)}
            found = minimize(energy, chord[k], (t0, t1), "SLSQP", constraints=constraint)  # type: ignore[call-overload]
            chord[k] = found.x
        spent.append(time.thread_time() - start)
    return min(spent)


def batch_s(method: str) -> dict[str, float]:
    """Time of BATCH_FRAMES frames by curve_points in one thread and in two, and the processor time of both.

    On a machine that does other things the clock on the wall says little of threads; that two of them need no
    more processor time than one says that they do not wait for each other.
    """
    s, t = node_arc_lengths(0.025, NODES), tangents(BATCH_FRAMES)
    halves = t[: BATCH_FRAMES // 2], t[BATCH_FRAMES // 2 :]
    with ThreadPoolExecutor(2) as pool:

        def one() -> object:
            return curve_points(s, t, method=method)  # type: ignore[arg-type]

        def two() -> object:
            return list(pool.map(lambda half: curve_points(s, half, method=method), halves))  # type: ignore[arg-type]

        # Turn by turn, so that what else the machine does meets both.
        rounds = np.array([[*_wall_and_processor_s(one), *_wall_and_processor_s(two)] for _ in range(8)])
    one_s, one_processor_s, two_s, two_processor_s = (float(x) for x in rounds.min(axis=0))
    return {
        "one_thread_s": one_s,
        "two_threads_s": two_s,
        "ratio": one_s / two_s,
        "one_thread_processor_s": one_processor_s,
        "two_threads_processor_s": two_processor_s,
    }


def _wall_and_processor_s(work: Callable[[], object]) -> tuple[float, float]:
    wall, processor = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - processor


def copy_s() -> float:
    """Time of copying as many bytes as BATCH_FRAMES frames read and write: what memory alone takes."""
    t = tangents(BATCH_FRAMES)
    return fastest_s(lambda: t.copy(), 0.5, time.thread_time)


def comb_s(ribbons: int, nodes: int, side: int, seconds: float = 0.5) -> float:
    """Time of one frame of a comb from Python, orientations to patches."""
    length = (2 * nodes - 1) * 0.025
    layout = CombLayout(0.025, nodes, tuple(length * j / ribbons for j in range(ribbons)))
    solver, q = CombSolver(layout, patch_vertices=side), orientations(1, ribbons, nodes)[0]
    valid = np.ones(q.shape[:-1], np.bool_)
    return fastest_s(lambda: solver.solve(q, valid), seconds)


def reference_comb_s() -> float:
    """Time of the same frame by the NumPy reference, with LAYOUT and patches of 8 x 8."""
    q = orientations(1, len(LAYOUT.start_m), NODES)[0]
    return fastest_s(
        lambda: reference.comb_frame(LAYOUT.node_s_m, np.array(LAYOUT.start_m), q, 8), 0.0, time.thread_time
    )


def measure_speed() -> dict[str, Any]:
    """All times in seconds, and their ratios."""
    update = {method: update_s(method) for method in ("hermite", "spline", "spherical")}
    slsqp, comb, slow_comb = slsqp_s(), comb_s(len(LAYOUT.start_m), NODES, 8), reference_comb_s()
    motion, slow_motion = motion_speed.native_s(), motion_speed.reference_s()
    batch = {method: batch_s(method) for method in ("hermite", "spline")}
    return {
        "machine": {
            "processors": os.cpu_count(),
            "machine": platform.machine(),
            "python": platform.python_version(),
        },
        "frame_of_16_nodes_s": {**update, "slsqp": slsqp},
        "slsqp_over_hermite": slsqp / update["hermite"],
        "spline_over_hermite": update["spline"] / update["hermite"],
        "comb_frame_s": {"native": comb, "numpy_reference": slow_comb, "ratio": slow_comb / comb},
        "motion_sample_s": {"native": motion, "numpy_reference": slow_motion, "ratio": slow_motion / motion},
        "batch": {"frames": BATCH_FRAMES, "copy_s": copy_s(), **batch},
        "growth": {
            "nodes": {
                str(n): {method: update_s(method, max(1, 4096 // n), n) for method in ("hermite", "spline")}
                for n in (16, 32, 64, 128, 256, 512, 1024)
            },
            "ribbons_of_16_nodes": {str(r): comb_s(r, NODES, 8, 0.2) for r in (2, 4, 8, 16, 32, 64)},
            "nodes_of_5_ribbons": {str(n): comb_s(5, n, 8, 0.2) for n in (16, 64, 256, 1024)},
        },
    }
