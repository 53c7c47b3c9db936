"""Bridging of invalid nodes in the C solver against the reference, and its rules at the ends of a ribbon."""

import numpy as np
import pytest
from reconstruct import combs
from ribbonhost.native._native import ffi, lib
from ribbonhost.reconstruct import reference


def bridge(s: np.ndarray, q: np.ndarray, valid: np.ndarray) -> tuple[int, np.ndarray]:
    out = np.empty_like(q)
    code = lib.ribbon_bridge(
        1,
        len(s),
        ffi.from_buffer("double[]", s),
        ffi.from_buffer("double[]", q),
        ffi.from_buffer("uint8_t[]", valid),
        ffi.from_buffer("double[]", out),
        ffi.NULL,
    )
    return code, out


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 11])
def test_bridge_agrees_with_reference(count: int) -> None:
    """Any pattern of valid nodes: same orientation to 1e-12."""
    rng = np.random.default_rng(31)
    s = np.cumsum(rng.uniform(0.02, 0.08, 12))
    q = combs.random_ribbon(rng, 12, 0.2)
    for _ in range(20):
        valid = np.zeros(12, bool)
        valid[rng.choice(12, count, replace=False)] = True
        code, out = bridge(s, np.where(valid[:, None], q, np.nan), valid)
        assert code == 12 - count
        expected = reference.bridge(s, q, valid)
        np.testing.assert_allclose(np.abs(np.einsum("kd,kd->k", out, expected)), 1, atol=1e-12)
        np.testing.assert_array_equal(out[valid], q[valid])


def test_ribbon_without_valid_nodes_becomes_nan() -> None:
    s = np.array([0.1, 0.2, 0.3])
    code, out = bridge(s, np.zeros((3, 4)), np.zeros(3, bool))
    assert code == 0
    assert np.isnan(out).all()


@pytest.mark.parametrize(
    ("s", "scale", "error"),
    [
        ([0.1, 0.1, 0.2], 1.0, lib.RIBBON_ERROR_NOT_INCREASING),
        ([-0.1, 0.1, 0.2], 1.0, lib.RIBBON_ERROR_NOT_INCREASING),
        ([0.1, 0.2, np.inf], 1.0, lib.RIBBON_ERROR_NOT_INCREASING),
        ([0.1, 0.2, 0.3], np.nan, lib.RIBBON_ERROR_NOT_FINITE),
        ([0.1, 0.2, 0.3], 1.001, lib.RIBBON_ERROR_NOT_UNIT),
    ],
)
def test_bridge_refuses_bad_input(s: list[float], scale: float, error: int) -> None:
    q = np.zeros((3, 4))
    q[:, 0] = scale
    assert bridge(np.array(s), q, np.ones(3, bool))[0] == error
