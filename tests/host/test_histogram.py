"""Quantiles need no memory for the samples."""

import math

import numpy as np
import pytest
from ribbonhost.pipeline.histogram import Histogram


def test_quantiles_are_within_one_percent() -> None:
    durations_s = np.random.default_rng(3).lognormal(-6, 1.5, 20_000)
    histogram = Histogram()
    for duration_s in durations_s:
        histogram.add(float(duration_s))
    for share in (0.01, 0.5, 0.99):
        exact_s = np.quantile(durations_s, share, method="inverted_cdf")
        assert histogram.quantile_s(share) == pytest.approx(exact_s, rel=0.0101)


def test_values_outside_the_range_count_at_its_ends() -> None:
    histogram = Histogram()
    for duration_s in (-1.0, 0.0, 1e9, math.inf):
        histogram.add(duration_s)
    assert histogram.quantile_s(0.25) < 1.1e-6
    assert histogram.quantile_s(1.0) > 90


def test_nothing_counted_has_no_quantile() -> None:
    histogram = Histogram()
    histogram.add(math.nan)
    assert math.isnan(histogram.quantile_s(0.5))
