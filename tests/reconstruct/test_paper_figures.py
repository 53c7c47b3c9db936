"""The paper's method on the paper's kind of data gives the figures that the design measured."""

import numpy as np
import pytest
from reconstruct import combs
from ribbonhost.reconstruct import error_percent
from ribbonhost.reconstruct.curve import curve_points


@pytest.mark.parametrize(
    ("scene", "expected_percent"), [("sea", 0.1574), ("wing", 0.0197), ("breath", 0.0505)]
)
def test_paper_method_with_exact_tangents_and_starts(scene: str, expected_percent: float) -> None:
    """16 nodes at 0 ... 750 mm, ribbons at 0 ... 450 mm, 8 phases, starting points exact: within 2 %."""
    _, ribbons = combs.reference_and_ribbons(scene, 8, 0.025, 31, [0, 6, 12, 18])
    truth_m, tangent = ribbons.position_m[:, :, ::2], ribbons.tangent[:, :, ::2]
    solved = curve_points(0.05 * np.arange(16), np.ascontiguousarray(tangent), method="hermite")
    solved += truth_m[:, :, :1]
    assert error_percent(solved, truth_m, 0.75) == pytest.approx(expected_percent, rel=0.02)
