"""Every error code of the C solver, and that bad input is refused, not computed with."""

from collections.abc import Callable

import numpy as np
import pytest
from ribbonhost.native._native import ffi, lib

D = np.float64
S3 = np.array([0.1, 0.2, 0.3])


def p(array: np.ndarray) -> object:
    kind = {np.dtype(np.float64): "double[]", np.dtype(np.float32): "float[]", np.dtype(bool): "uint8_t[]"}
    return ffi.from_buffer(kind[array.dtype], array)


def room(count: int = 4000) -> object:
    return ffi.new("double[]", count)


def orientations(count: int, scale: float = 1.0) -> np.ndarray:
    q = np.zeros((count, 4))
    q[:, 0] = scale
    return q


def tangents() -> object:
    return p(np.tile(np.array([1.0, 0, 0]), (3, 1)))


CURVES: dict[str, Callable[[int, np.ndarray], int]] = {
    "bridge": lambda n, s: lib.ribbon_bridge(1, n, p(s), p(orientations(3)), ffi.NULL, room(), ffi.NULL),
    "hermite update": lambda n, s: lib.ribbon_hermite_update(1, n, p(s), tangents(), room(), room()),
    "hermite points": lambda n, s: lib.ribbon_hermite_points(1, n, p(s), room(), room(), 1, room(), room()),
    "spline update": lambda n, s: lib.ribbon_spline_update(1, n, p(s), tangents(), room(), room(), room()),
    "spline points": lambda n, s: lib.ribbon_spline_points(
        1, n, p(s), tangents(), room(), room(), 1, room(), room()
    ),
    "spherical update": lambda n, s: lib.ribbon_spherical_update(
        1, n, p(s), tangents(), room(), room(), room()
    ),
    "spherical points": lambda n, s: lib.ribbon_spherical_points(
        1, n, p(s), tangents(), room(), tangents(), 1, room(), room()
    ),
    "curvature": lambda n, s: lib.ribbon_curvature(1, n, p(s), tangents(), room(), room(), room()),
    "sensitivity": lambda n, s: lib.ribbon_sensitivity(
        1, n, p(s), p(orientations(3)), ffi.NULL, 1, room(), room(), room(), room()
    ),
    "transversals": lambda n, s: lib.ribbon_transversals(3, n, p(s), room(), room(), room(), room()),
    "patches": lambda n, s: lib.ribbon_patches(
        2,
        n,
        p(s),
        p(S3),
        room(),
        room(),
        room(),
        ffi.NULL,
        2,
        1.0,
        ffi.new("float[]", 99),
        ffi.new("float[]", 99),
    ),
    "comb": lambda n, s: comb_frame(nodes=n, s=s),
}


def comb_frame(
    ribbons: int = 2,
    nodes: int = 3,
    side: int = 2,
    method: int = lib.RIBBON_METHOD_SPLINE,
    twist: int = lib.RIBBON_TWIST_ZERO,
    s: np.ndarray = S3,
    start: tuple[float, ...] = (0.0, 0.2),
    scale: float = 1.0,
) -> int:
    kept = [ffi.new("double[]", s.tolist()), ffi.new("double[]", list(start))]
    comb = ffi.new("struct ribbon_comb *", (ribbons, nodes, side, method, twist, *kept))
    fields = ("anchor", "node", "tangent", "along", "transversal", "twist", "lambda")
    memory = {name: room() for name in fields}
    memory |= {"ribbon_valid": ffi.new("uint8_t[]", 99), "held": ffi.new("int32_t[]", 9)}
    frame = ffi.new("struct ribbon_comb_frame *", memory)
    return lib.ribbon_comb_frames(comb, 1, p(orientations(9, scale)), ffi.NULL, frame, room())


@pytest.mark.parametrize("name", CURVES)
def test_good_input_is_taken(name: str) -> None:
    assert CURVES[name](3, S3) >= 0


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("nodes", [0, 1, lib.RIBBON_NODE_LIMIT + 1, 2**63])
def test_counts_outside_the_limits(name: str, nodes: int) -> None:
    assert CURVES[name](nodes, S3) == lib.RIBBON_ERROR_COUNT


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize(
    "s",
    [
        (0.1, 0.1, 0.2),
        (0.3, 0.2, 0.1),
        (-0.1, 0.1, 0.2),
        (0.1, np.nan, 0.3),
        (np.nan, 0.1, 0.2),
        (0.1, 0.2, np.inf),
    ],
)
def test_arc_lengths_that_do_not_grow(name: str, s: tuple[float, ...]) -> None:
    assert CURVES[name](3, np.array(s)) == lib.RIBBON_ERROR_NOT_INCREASING


@pytest.mark.parametrize("at", [-1e-12, 0.3 + 1e-12, np.nan])
def test_points_outside_the_ribbon(at: float) -> None:
    a, s, t = p(np.array([at])), p(S3), tangents()
    assert lib.ribbon_hermite_points(1, 3, s, room(), room(), 1, a, room()) == lib.RIBBON_ERROR_OUTSIDE
    assert lib.ribbon_spline_points(1, 3, s, t, room(), room(), 1, a, room()) == lib.RIBBON_ERROR_OUTSIDE
    assert lib.ribbon_spherical_points(1, 3, s, t, room(), t, 1, a, room()) == lib.RIBBON_ERROR_OUTSIDE
    q = p(orientations(3))
    assert (
        lib.ribbon_sensitivity(1, 3, s, q, ffi.NULL, 1, a, room(), room(), room()) == lib.RIBBON_ERROR_OUTSIDE
    )


def test_sensitivity_without_a_valid_node() -> None:
    s, q, none, at = p(S3), p(orientations(3)), p(np.zeros(3, bool)), p(np.array([0.1]))
    code = lib.ribbon_sensitivity(1, 3, s, q, none, 1, at, room(), room(), room())
    assert code == lib.RIBBON_ERROR_NO_VALID_NODE


@pytest.mark.parametrize(
    ("v", "code"),
    [
        ([1.0, 0, 0], 0),
        ([np.nan, 0, 1], lib.RIBBON_ERROR_NOT_FINITE),
        ([np.inf, 0, 0], lib.RIBBON_ERROR_NOT_FINITE),
        ([0.0, 0, 0], lib.RIBBON_ERROR_NOT_UNIT),
        ([1.001, 0, 0], lib.RIBBON_ERROR_NOT_UNIT),
    ],
)
def test_directions_are_checked(v: list[float], code: int) -> None:
    assert lib.ribbon_check_directions(2, p(np.array([[0.0, 1, 0], v]))) == code


def test_combs_that_cannot_be() -> None:
    for wrong in ({"ribbons": 1}, {"ribbons": 1025}, {"side": 1}, {"side": 65}, {"nodes": 1}):
        assert comb_frame(**wrong) == lib.RIBBON_ERROR_COUNT
    assert comb_frame(method=lib.RIBBON_METHOD_SPHERICAL) == lib.RIBBON_ERROR_METHOD
    assert comb_frame(method=9) == lib.RIBBON_ERROR_METHOD
    assert comb_frame(twist=2) == lib.RIBBON_ERROR_METHOD
    assert comb_frame(start=(0.2, 0.1)) == lib.RIBBON_ERROR_NOT_INCREASING
    assert comb_frame(start=(0.0, 0.31)) == lib.RIBBON_ERROR_OUTSIDE
    assert comb_frame(scale=np.nan) == lib.RIBBON_ERROR_NOT_FINITE
    assert comb_frame(scale=1.001) == lib.RIBBON_ERROR_NOT_UNIT
    assert comb_frame(scale=0.0) == lib.RIBBON_ERROR_NOT_UNIT


def test_batches_beyond_the_limit() -> None:
    """As many nodes as can be counted in the result."""
    too_many = lib.RIBBON_BATCH_LIMIT + 1
    assert lib.RIBBON_BATCH_LIMIT * lib.RIBBON_NODE_LIMIT <= 2**31 - 1 < too_many * lib.RIBBON_NODE_LIMIT
    s, q = p(S3), p(orientations(3))
    assert lib.ribbon_bridge(too_many, 3, s, q, ffi.NULL, room(), ffi.NULL) == lib.RIBBON_ERROR_COUNT
    assert lib.ribbon_hermite_update(too_many, 3, s, q, room(), room()) == lib.RIBBON_ERROR_COUNT


def test_workspace_of_counts_outside_the_limits_is_none() -> None:
    comb = ffi.new("struct ribbon_comb *", {"ribbons": 1, "nodes": 16, "side": 8})
    assert lib.ribbon_comb_workspace(comb) == 0
    assert lib.ribbon_sensitivity_workspace(1) == 0
    assert lib.ribbon_sensitivity_workspace(lib.RIBBON_NODE_LIMIT + 1) == 0


@pytest.mark.parametrize("tau", [0.0, -1.0, np.nan, np.inf])
def test_smoothing_needs_a_time_constant(tau: float) -> None:
    state = p(np.full(13, np.nan))
    code = lib.ribbon_smooth(1, 1, p(np.array([0.0])), tau, p(orientations(1)), ffi.NULL, state, room())
    assert code == lib.RIBBON_ERROR_NOT_FINITE


def test_smoothing_needs_times_that_grow() -> None:
    for times, code in (
        ([0.0, 0.0], lib.RIBBON_ERROR_NOT_INCREASING),
        ([1.0, 0.0], lib.RIBBON_ERROR_NOT_INCREASING),
        ([0.0, np.nan], lib.RIBBON_ERROR_NOT_FINITE),
        ([0.0, 1.0], 0),
    ):
        state = p(np.full(13, np.nan))
        assert (
            lib.ribbon_smooth(2, 1, p(np.array(times)), 1.0, p(orientations(2)), ffi.NULL, state, room())
            == code
        )


def test_header_names_no_code_without_a_test() -> None:
    """All codes of enum ribbon_error appear in this file."""
    with open(__file__, encoding="utf-8") as file:
        text = file.read()
    codes = list(ffi.typeof("enum ribbon_error").relements)
    assert len(codes) == 7
    assert [code for code in codes if f"lib.{code}" not in text] == []
