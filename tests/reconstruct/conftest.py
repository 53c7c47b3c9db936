"""The exact combs on scenes, traced once a session."""

from collections.abc import Callable
from functools import cache

import pytest
from reconstruct import combs


@pytest.fixture(scope="session")
def true_comb() -> Callable[..., combs.TrueComb]:
    """`combs.true_comb`, which remembers its results."""
    return cache(combs.true_comb)
