"""The offset of an AMR bridge, cancelled by flipping it between samples."""

from __future__ import annotations

import numpy as np
import pytest
from ribbonhil._firmware import ffi, lib

OFFSET = np.array([5000.0, -7000.0, 300.0])  # counts; the part allows 8192
PAIRS_MAX = 400


class Bridge:
    def __init__(self) -> None:
        self.c = ffi.new("struct bridge_offset *")
        lib.bridge_offset_reset(self.c)

    def take(self, field: np.ndarray, polarity: int, noise: np.ndarray | float = 0.0):
        """The field told, or None while the offset is not known."""
        raw = (1 - 2 * polarity) * field + OFFSET + noise
        counts = ffi.new("int32_t[3]", np.rint(raw).astype(int).tolist())
        known = lib.bridge_offset_cancel(self.c, polarity, PAIRS_MAX, counts)
        return np.array(list(counts)) if known else None


def test_offset_is_known_from_the_second_sample_on():
    bridge = Bridge()
    field = np.array([1000.0, 2000.0, -3000.0])
    assert bridge.take(field, 0) is None
    assert bridge.take(field, 1) == pytest.approx(field, abs=1)
    assert bridge.take(field, 0) == pytest.approx(field, abs=1)


def test_samples_of_one_polarity_tell_no_offset():
    bridge = Bridge()
    assert all(bridge.take(np.zeros(3), 1) is None for _ in range(5))


@pytest.mark.parametrize("flip_every", [1, 4])
def test_steady_motion_between_polarities_does_no_harm(flip_every):
    """A field that changes by 60 counts a sample (half of noise times ten): the offset stays within 6 counts.

    A single pair would be 30 counts off.
    """
    bridge = Bridge()
    errors = []
    for i in range(2000):
        field = np.array([3000.0, 0, -2000]) + 60.0 * (i - 1000)
        told = bridge.take(field, (i // flip_every) % 2)
        if i > 800:
            errors.append(np.abs(told - field).max())
    assert np.mean(errors) < 6


def test_noise_of_the_offset_is_small_against_that_of_a_sample():
    """10 counts of noise: once the mean is full, what is told has hardly more than that."""
    rng = np.random.default_rng(1)
    bridge = Bridge()
    field = np.array([2000.0, -1000.0, 4000.0])
    told = [bridge.take(field, i % 2, 10 * rng.normal(size=3)) for i in range(2000)]
    assert np.std(np.array(told[500:]) - field) < 10.3


def test_offset_that_drifts_is_followed():
    """1 count in 10 samples, as in a part that warms up by 1 K a second: followed within 45 counts."""
    bridge = Bridge()
    for i in range(3000):
        told = bridge.take(np.zeros(3), i % 2, noise=np.full(3, 0.1 * i))
    assert np.abs(told).max() < 45
