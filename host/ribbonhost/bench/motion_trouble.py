"""What goes wrong in cases of the motion benchmark: at the sensors, and on the way to the host."""

import dataclasses
from collections.abc import Callable

import numpy as np

from ribbonhost.bench.motion_truth import Case, Float64, Truth, times_s
from ribbonhost.motion import Samples

GRAVITY_MPS2 = 9.80665
QUIET_S = 1.5
"""Shocks and taps begin so late, one every QUIET_S."""

HOLE_S = (4.0, 4.3)
LOST_SHARE = 0.05
DEAD_NODES = (5, 10)
MAGNETIC_NODES = (6, 7, 8)
MAGNET_STARTS_S = 2.0


def at_sensors(case: Case, truth: Truth) -> Truth:
    """The truth as faulty sensors would feel it; positions and orientations stay."""
    random = np.random.default_rng([case.seed, 2])
    force, field = truth.force_mps2.copy(), truth.field_ut.copy()
    t_s = times_s(len(force))
    for name in case.trouble:
        if name in _SENSOR_TROUBLE:
            _SENSOR_TROUBLE[name](t_s, force, field, random)
    return dataclasses.replace(truth, force_mps2=force, field_ut=field)


def on_the_way(case: Case, samples: Samples) -> Samples:
    """The samples that arrive."""
    if "lost frames" not in case.trouble:
        return samples
    random = np.random.default_rng([case.seed, 3])
    t_s = samples.t_s
    kept = (random.random(len(t_s)) >= LOST_SHARE) & ~((t_s >= HOLE_S[0]) & (t_s < HOLE_S[1]))
    return Samples(**{f.name: getattr(samples, f.name)[kept] for f in dataclasses.fields(samples)})


def dead_slots(case: Case) -> list[int]:
    """Slots of sensors that do not answer."""
    return (
        [slot for node in DEAD_NODES for slot in (2 * node, 2 * node + 1)]
        if "dead nodes" in case.trouble
        else []
    )


def _leftover(t_s: Float64, force: Float64, field: Float64, random: np.random.Generator) -> None:
    """Calibration that leaves 2 mg, 0.3 % of scale, 0.3 deg of mounting and 0.5 % of the field."""
    slots = force.shape[1]
    axis = random.normal(size=(slots, 3))
    axis *= np.radians(0.3) / np.linalg.norm(axis, axis=1, keepdims=True)
    for table in (force, field):
        table += np.cross(axis, table)
        table *= 1.0 + 0.003 * random.normal(size=(slots, 3))
    strength = np.linalg.norm(field[0, 0])
    force += 2e-3 * GRAVITY_MPS2 * random.normal(size=(slots, 3))
    field += 0.005 * strength / np.sqrt(3) * random.normal(size=(slots, 3))


def _magnetised(t_s: Float64, force: Float64, field: Float64, random: np.random.Generator) -> None:
    """From MAGNET_STARTS_S on, 15 % of the field beside three neighbouring nodes."""
    late = t_s >= MAGNET_STARTS_S
    strength = np.linalg.norm(field[0, 0])
    for node in MAGNETIC_NODES:
        field[late, 2 * node + 1] += 0.15 * strength * random.normal(size=3)


def _magnet_passing(t_s: Float64, force: Float64, field: Float64, random: np.random.Generator) -> None:
    """A magnet that moves along the ribbon, 8 nodes a second, every 6 s; at its nearest half of the field."""
    strength = np.linalg.norm(field[0, 0])
    direction = np.array([0.7, 0.5, -0.5])
    for node in range(field.shape[1] // 2):
        distance = node - (np.mod(t_s, 6.0) - 3.0) * 8.0
        field[:, 2 * node + 1] += 0.5 * strength * np.exp(-((distance / 2.0) ** 2))[:, None] * direction


def _taps(t_s: Float64, force: Float64, field: Float64, random: np.random.Generator) -> None:
    """Three neighbouring accelerometers are hit: 5 g, dying away within 10 ms, every QUIET_S."""
    for start_s in np.arange(QUIET_S, t_s[-1], QUIET_S):
        first = 2 * int(random.integers(0, 13))
        decay = np.where(t_s >= start_s, np.exp(-np.maximum(t_s - start_s, 0.0) / 0.01), 0.0)
        for slot in range(first, first + 6, 2):
            force[:, slot] += 5 * GRAVITY_MPS2 * decay[:, None] * random.normal(size=3)


def _shocks(t_s: Float64, force: Float64, field: Float64, random: np.random.Generator) -> None:
    """All accelerometers ring: 8 g beyond the range in common and 2 g each, within 20 ms, every QUIET_S."""
    for start_s in np.arange(QUIET_S, t_s[-1], QUIET_S):
        decay = np.where(t_s >= start_s, np.exp(-np.maximum(t_s - start_s, 0.0) / 0.02), 0.0)[:, None, None]
        common = 8 * random.normal(size=(1, 1, 3))
        force += GRAVITY_MPS2 * decay * (common + 2 * random.normal(size=(1, force.shape[1], 3)))


_SENSOR_TROUBLE: dict[str, Callable[[Float64, Float64, Float64, np.random.Generator], None]] = {
    "leftover calibration": _leftover,
    "magnetised nodes": _magnetised,
    "magnet passing": _magnet_passing,
    "taps": _taps,
    "shocks": _shocks,
}
