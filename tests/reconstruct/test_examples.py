"""The example that the package gives for a notebook runs as it stands."""

import doctest

from ribbonhost import reconstruct


def test_example_of_the_package_runs() -> None:
    failed, tried = doctest.testmod(reconstruct)
    assert tried > 10
    assert failed == 0


def test_public_names_are_documented() -> None:
    for name in reconstruct.__all__:
        assert getattr(reconstruct, name).__doc__, name
