"""Readings of packets become calibrated samples."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from ribbonhost.motion.scans import Sampler

NODES = 6


def some_scan(random: np.random.Generator) -> tuple[Any, Any]:
    """A RAW and the nodes of its ORIENT, as far as a sampler looks at them."""
    kinds = [
        SimpleNamespace(counts=random.integers(-9999, 9999, (NODES, 3)), reason=np.zeros(NODES, np.uint8))
        for _ in range(2)
    ]
    raw = SimpleNamespace(accels=kinds[0], mags=kinds[1], accel_age_us=int(random.integers(9999)))
    nodes = SimpleNamespace(
        q_world_node=random.normal(size=(NODES, 4)),
        valid=np.ones(NODES, np.bool_),
        quality=np.zeros(NODES, np.uint8),
    )
    return raw, nodes


def some_sampler(random: np.random.Generator) -> Sampler:
    info: Any = SimpleNamespace(slots=SimpleNamespace(lsb=random.uniform(0.01, 0.02, 2 * NODES)))
    calibration: Any = SimpleNamespace(
        slots=SimpleNamespace(
            offset=random.normal(size=(2 * NODES, 3)), matrix=random.normal(size=(2 * NODES, 9))
        )
    )
    return Sampler(info, calibration)


def test_scans_of_several_ribbons_are_each_calibrated_by_their_own_record() -> None:
    random = np.random.default_rng(0)
    samplers = [some_sampler(random) for _ in range(3)]
    scans = [some_scan(random) for _ in samplers]
    t_s = np.array([1.0, 2.0, 3.0])
    together = Sampler.of_each(samplers).samples(scans, t_s)
    for row, sampler in enumerate(samplers):
        alone = sampler.samples([scans[row]], t_s[row : row + 1])
        for name in ("t_s", "force_mps2", "field_ut", "level_q"):
            np.testing.assert_allclose(getattr(together, name)[row], getattr(alone, name)[0], rtol=1e-12)
