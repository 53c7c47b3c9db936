"""Orientations from specific force and field: right, honest about noise, deaf to garbage."""

from __future__ import annotations

import numpy as np
import pytest
from firmware.c_arrays import view
from firmware.fused_ribbon import (
    AMBIGUOUS,
    FIELD_DIP,
    FIELD_MAGNITUDE,
    FIELD_UT,
    GRAVITY_MPS2,
    MOVING,
    NODES,
    Fusion,
    errors_deg,
    readings,
    twisted,
)
from firmware.rotations import matrices, random_quaternions
from ribbonhil._firmware import lib

GARBAGE = (np.nan, np.inf, -np.inf, 3e38, -3e38, 1e5)


def straight(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A straight ribbon: one orientation everywhere."""
    return np.tile(q, (NODES, 1)), np.tile(q, (NODES, 1))


def test_straight_ribbon_is_exact_in_any_attitude():
    """0.003 deg, single precision, three axes."""
    for q in random_quaternions(np.random.default_rng(1), 200):
        pair = straight(q)
        result = Fusion().scan(*readings(*pair))
        assert result.valid.all()
        assert errors_deg(result, pair[1]).max() < 0.003


@pytest.mark.parametrize("two_axes", [False, True])
def test_bent_ribbon_is_exact_to_the_order_of_its_interpolation(two_axes):
    """0.2 rad from sensor to sensor: 0.12 deg within (two axes 0.25), 3 sigma at the ends; no noise."""
    rng = np.random.default_rng(2)
    for _ in range(40):
        pair = twisted(rng, 0.2)
        fusion = Fusion(two_axes=two_axes)
        result = fusion.scan(*readings(*pair))
        assert result.valid.all()
        error = errors_deg(result, pair[1])
        settled = (result.flags & AMBIGUOUS == 0) & (result.sigma_deg < 2)
        assert np.max(error[1:-1], where=settled[1:-1], initial=0) < (0.25 if two_axes else 0.12)
        assert (error[settled] < 3 * result.sigma_deg[settled]).all()


def test_tilted_two_axis_magnetometers_are_as_exact_as_straight_ones():
    """Mounted 5 deg off, each its own way: the median error stays below 0.03 deg, as without tilt; no noise.

    The missing component lies along each part's own normal. Looked for along the node's, it would be wrong
    by 5 deg times the field: a median of more than a degree.
    """
    rng = np.random.default_rng(21)
    direction = rng.uniform(0, 2 * np.pi, NODES)
    tilt = np.radians(5.0)
    normals = np.stack([np.sin(tilt) * np.cos(direction), np.sin(tilt) * np.sin(direction)], axis=1)
    normals = np.column_stack([normals, np.full(NODES, np.cos(tilt))])
    error = {"straight": [], "tilted": [], "not told": []}
    for _ in range(40):
        pair = twisted(rng, 0.05)
        accel, field = readings(*pair)
        for name, collected in error.items():
            fusion = Fusion(two_axes=True)
            if name != "straight":
                view(fusion.params.blind)[:] = normals
            seen = field - np.sum(field * view(fusion.params.blind), axis=1)[:, None] * view(
                fusion.params.blind
            )
            if name == "not told":
                view(fusion.params.blind)[:] = [0, 0, 1]
            result = fusion.scan(accel, seen)
            settled = (result.flags & AMBIGUOUS == 0) & (result.sigma_deg < 2)
            collected.append(errors_deg(result, pair[1])[settled])
    median = {name: np.median(np.concatenate(values)) for name, values in error.items()}
    assert median["straight"] < 0.03
    assert median["tilted"] < 0.03
    assert median["not told"] > 1.0


def test_quaternion_turns_node_vectors_into_world_vectors():
    """A ribbon that points north, its normal up: x of the node is north, y west, z up."""
    accel = np.tile([0, 0, GRAVITY_MPS2], (NODES, 1))
    field = np.tile([FIELD_UT[1], 0, FIELD_UT[2]], (NODES, 1))
    r = matrices(Fusion().scan(accel, field).q)
    assert r[0] == pytest.approx(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), abs=1e-5)


def monte_carlo(two_axes: bool, accel_share: float, field_share: float, seed: int, ribbons: int):
    """Errors and sigmas (deg) of random ribbons whose readings are off by so much of g and of the field."""
    rng = np.random.default_rng(seed)
    errors, sigmas, flags = [], [], []
    for _ in range(ribbons):
        pair = twisted(rng, 0.15)
        accel, field = readings(*pair)
        accel = accel + accel_share * GRAVITY_MPS2 * rng.normal(size=accel.shape)
        field = field + field_share * np.linalg.norm(FIELD_UT) * rng.normal(size=field.shape)
        result = Fusion(two_axes=two_axes).scan(accel, field)
        errors.append(errors_deg(result, pair[1]))
        sigmas.append(result.sigma_deg)
        flags.append(result.flags)
    return np.ravel(errors), np.ravel(sigmas), np.ravel(flags)


@pytest.mark.parametrize(("two_axes", "seed"), [(False, 3), (True, 4)])
def test_sigma_is_honest(two_axes, seed):
    """With the errors of params (0.3 % g, 0.5 % B) 99 % are within 3 sigma, and sigma is no exaggeration.

    Of nodes whose heading is ambiguous the chosen one may be the other; they are told, and not counted.
    """
    errors, sigmas, flags = monte_carlo(two_axes, 0.003, 0.005, seed, 300)
    usable = np.isfinite(errors) & (flags & AMBIGUOUS == 0)
    ratio = errors[usable] / sigmas[usable]
    assert np.mean(ratio < 3) >= 0.99
    # The largest of three axes is told, the whole angle is compared: a little above 0.68 is expected.
    assert 0.5 < np.mean(ratio < 1) < 0.9
    assert np.isfinite(errors).mean() > 0.97
    assert np.mean(flags & AMBIGUOUS != 0) < (0.07 if two_axes else 1e-9)


def test_five_axes_are_as_good_as_their_cramer_rao_bound():
    """DESIGN: dip 62 deg, 0.3 % g, 0.5 % B: six axes 0.73 deg, five: median 0.82, p95 2.1. Within 20 %."""
    _, six, _ = monte_carlo(False, 0.003, 0.005, 5, 60)
    _, five, flags = monte_carlo(True, 0.003, 0.005, 6, 200)
    five = five[(flags & AMBIGUOUS == 0) & np.isfinite(five)]
    assert np.median(six) == pytest.approx(0.73, rel=0.2)
    assert np.median(five) == pytest.approx(0.82, rel=0.2)
    assert np.percentile(five, 95) == pytest.approx(2.1, rel=0.3)


def test_two_axes_know_least_where_a_vertical_plane_runs_along_the_meridian():
    """Sigma tells geometry: it is large where what is measured changes with heading to second order only."""
    level = np.eye(3)  # rows: the world's axes in the node's frame
    facing_south = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # x east, y up, z south
    facing_east = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # x north, y up, z east
    sigma_deg, flags = [], []
    for r in (level, facing_south, facing_east):
        accel = np.tile(GRAVITY_MPS2 * r[2], (NODES, 1))
        field = np.tile(FIELD_UT @ r, (NODES, 1))
        result = Fusion(two_axes=True).scan(accel, field)
        sigma_deg.append(result.sigma_deg[5])
        flags.append(result.flags[5])
    assert sigma_deg[0] < 1.0
    assert sigma_deg[1] == pytest.approx(sigma_deg[0], rel=0.1), (
        "north is in the normal: x turns with heading"
    )
    assert sigma_deg[2] > 4 * sigma_deg[0], "north is along x, where a cosine has its maximum"
    assert flags[0] == 0
    assert flags[1:] == [AMBIGUOUS, AMBIGUOUS], "two headings far apart, and many close to each other"


@pytest.mark.parametrize("two_axes", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_garbage_leaves_no_trace(two_axes, seed):
    """After 30 scans with NaN, infinities and absurd numbers, clean readings give what they gave before.

    A field that was off is not trusted for another half second.
    """
    rng = np.random.default_rng(seed)
    pair = twisted(rng, 0.1)
    accel, field = readings(*pair)
    fusion = Fusion(two_axes=two_axes)
    expected = fusion.scan(accel, field)
    for _ in range(30):
        bad_accel, bad_field = accel.copy(), field.copy()
        for values in (bad_accel, bad_field):
            hit = rng.random(values.shape) < 0.3
            values[hit] = rng.choice(GARBAGE, hit.sum())
        result = fusion.scan(bad_accel.astype(np.float32), bad_field.astype(np.float32))
        assert np.isfinite(result.q).all()
        assert np.linalg.norm(result.q, axis=1) == pytest.approx(1, abs=1e-5)
        assert np.isfinite(result.sigma_deg[result.valid]).all()
    after = fusion.scan(accel, field)
    assert after.valid.all()
    for _ in range(51):
        after = fusion.scan(accel, field)
    settled = expected.flags & AMBIGUOUS == 0
    assert errors_deg(after, expected.q)[settled].max() < 0.05


@pytest.mark.parametrize("dt_s", [0.0, -1.0, np.nan, np.inf, 1e-30, 1e30])
def test_absurd_intervals_poison_nothing(dt_s):
    pair = twisted(np.random.default_rng(5), 0.1)
    accel, field = readings(*pair)
    fusion = Fusion()
    for _ in range(3):
        fusion.input.dt_s = dt_s
        fusion.scan(accel + 0.01, field)
    fusion.input.dt_s = 0.01
    for _ in range(200):
        result = fusion.scan(accel, field)
    assert errors_deg(result, pair[1])[1:-1].max() < 0.1


@pytest.mark.parametrize("node", [0, 1, 7, 14, 15])
def test_dead_magnetometer_is_bridged_with_a_larger_sigma(node):
    pair = twisted(np.random.default_rng(6), 0.15)
    fusion = Fusion()
    healthy = fusion.scan(*readings(*pair))
    fusion.field_valid[node] = False
    bridged = fusion.scan(*readings(*pair))
    assert bridged.valid.all()
    assert errors_deg(bridged, pair[1])[node] < 3 * bridged.sigma_deg[node]
    assert errors_deg(bridged, pair[1])[node] < 4.0
    assert bridged.sigma_deg[node] > healthy.sigma_deg[node]
    others = np.arange(NODES) != node
    assert np.array_equal(bridged.q[others], healthy.q[others]), "no other node knows of it"


@pytest.mark.parametrize("accel", [0, 1, 7, 14, 15])
def test_dead_accelerometer_is_bridged_with_a_larger_sigma(accel):
    pair = twisted(np.random.default_rng(7), 0.15)
    fusion = Fusion()
    healthy = fusion.scan(*readings(*pair))
    fusion.accel_valid[accel] = False
    bridged = fusion.scan(*readings(*pair))
    assert bridged.valid.all()
    near = np.abs(2 * np.arange(NODES) + 1 - 2 * accel) <= 1
    assert (bridged.sigma_deg[near] > healthy.sigma_deg[near]).all()
    assert (errors_deg(bridged, pair[1]) < 3 * bridged.sigma_deg).all()
    far = np.abs(2 * np.arange(NODES) + 1 - 2 * accel) > 9
    assert np.array_equal(bridged.q[far], healthy.q[far])


def test_ribbon_without_sensors_has_no_orientations():
    fusion = Fusion()
    fusion.accel_valid[:] = False
    result = fusion.scan(*readings(*straight(np.array([1.0, 0, 0, 0]))))
    assert not result.valid.any()
    assert np.isnan(result.sigma_deg).all()
    fusion.accel_valid[:], fusion.field_valid[:] = True, False
    assert not fusion.scan(*readings(*straight(np.array([1.0, 0, 0, 0])))).valid.any()


def test_branch_stays_with_the_motion_through_an_ambiguous_attitude():
    """A ribbon turns about a level axis until its plane is vertical and beyond: the heading does not jump.

    Between the attitudes with two headings the truth is followed within 3 sigma, and 3 deg.
    """
    from scipy.spatial.transform import Rotation

    heading = Rotation.from_euler("z", 35, degrees=True)
    fusion = Fusion(two_axes=True)
    seen_ambiguous = 0
    for tilt in np.arange(0, 150, 0.4):
        q = np.roll((heading * Rotation.from_euler("x", tilt, degrees=True)).as_quat(), 1)
        pair = straight(q)
        result = fusion.scan(*readings(*pair))
        seen_ambiguous += int(result.flags[8] & AMBIGUOUS != 0)
        error = errors_deg(result, pair[1])[8]
        assert error < max(3.0, 3 * result.sigma_deg[8]), f"tilt {tilt} deg"
    assert seen_ambiguous > 0


def noisy_scans(fusion: Fusion, q: np.ndarray, scans: int, seed: int, *, accel=0.05, field=0.6):
    """Result of the last of some scans of a ribbon at rest, with noise of m/s^2 and uT."""
    rng = np.random.default_rng(seed)
    ideal = readings(*straight(q))
    for _ in range(scans):
        result = fusion.scan(
            ideal[0] + accel * rng.normal(size=ideal[0].shape),
            ideal[1] + field * rng.normal(size=ideal[1].shape),
        )
    return result


def test_rest_takes_noise_away():
    """0.3 s at rest: the mean of some 30 readings, with an error at least 4 times below a reading's."""
    q = random_quaternions(np.random.default_rng(8), 1)[0]
    first = noisy_scans(Fusion(), q, 1, 9)
    rested = noisy_scans(Fusion(), q, 200, 9)
    pair = straight(q)
    assert errors_deg(first, pair[1]).mean() > 4 * errors_deg(rested, pair[1]).mean()
    assert rested.sigma_deg[5] < 0.6 * first.sigma_deg[5] or first.sigma_deg[5] < 1
    assert not (rested.flags & MOVING).any()


@pytest.mark.parametrize("rate_hz", [10, 50, 100, 200])
def test_motion_is_followed_without_lag_at_any_rate(rate_hz):
    """0.2 rad/s with part noise: the mean error over a second, noise averaged out, is below 0.15 deg."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(10)
    fusion = Fusion(rate_hz=rate_hz)
    lag = []
    for i in range(2 * rate_hz):
        turned = 0.2 * i / rate_hz
        pair = straight(np.roll(Rotation.from_euler("x", turned).as_quat(), 1))
        accel, field = readings(*pair)
        result = fusion.scan(
            accel + 0.004 * rng.normal(size=accel.shape), field + 0.06 * rng.normal(size=field.shape)
        )
        if i >= rate_hz:
            behind = Rotation.from_quat(np.roll(result.q, -1, axis=1)).inv() * Rotation.from_euler(
                "x", turned
            )
            lag.append(behind.as_rotvec()[:, 0].mean())
    assert abs(np.degrees(np.mean(lag))) < 0.15


def test_old_readings_are_brought_up_to_date():
    """Readings 15 ms old on a ribbon that turns by 0.3 rad/s are 0.26 deg behind; less than 0.05 is left."""
    from scipy.spatial.transform import Rotation

    fusion = Fusion()
    view(fusion.input.accel_age_s)[:] = 0.015
    view(fusion.input.field_age_s)[:] = 0.015
    for i in range(200):
        old = straight(np.roll(Rotation.from_euler("x", 0.3 * (0.01 * i - 0.015)).as_quat(), 1))
        result = fusion.scan(*readings(*old))
    now = straight(np.roll(Rotation.from_euler("x", 0.3 * 0.01 * 199).as_quat(), 1))
    assert errors_deg(result, now[1]).max() < 0.05


def flags_after(change, *, scans: int = 100, fusion: Fusion | None = None) -> np.ndarray:
    """Flags of a level ribbon whose readings `change(i, accel, field)` alters in scan i, after some scans."""
    fusion = fusion or Fusion()
    ideal = readings(*straight(np.array([0.8, 0.36, 0.48, 0.0])))
    for i in range(scans):
        accel, field = ideal[0].copy(), ideal[1].copy()
        change(i, accel, field)
        result = fusion.scan(accel, field)
    return result.flags


def test_ribbon_at_rest_has_no_flags():
    assert not flags_after(lambda i, a, m: None).any()


def test_acceleration_is_called_moving():
    def push(i, accel, field):
        accel *= 1.05

    def shake(i, accel, field):
        accel[:, 0] += 0.8 * (-1) ** i

    assert (flags_after(push) & MOVING).all()
    assert (flags_after(shake) & MOVING).all()


def test_moving_is_told_for_the_nodes_it_concerns_and_half_a_second_longer():
    def push(i, accel, field):
        if i < 50:
            accel[8] *= 1.1

    flags = flags_after(push, scans=50)
    assert np.flatnonzero(flags & MOVING).tolist() == [7, 8], "between the neighbours of accelerometer 8"
    assert (flags_after(push, scans=95)[7:9] & MOVING).all()
    assert not (flags_after(push, scans=150) & MOVING).any()


def test_tap_is_told_and_forgotten_within_a_second():
    """2 g for two scans, across gravity, where |a| of a mean over 0.3 s says nothing of it."""
    across = np.cross([0.3, 0.5, 0.8], readings(*straight(np.array([0.8, 0.36, 0.48, 0.0])))[0][0])
    across *= 2 * GRAVITY_MPS2 / np.linalg.norm(across)

    def tap(i, accel, field):
        if i in (100, 101):
            accel += across

    assert (flags_after(tap, scans=103) & MOVING).all()
    assert (flags_after(tap, scans=145) & MOVING).all()
    assert not flags_after(tap, scans=190).any()


def test_wrong_field_strength_is_told():
    def strengthen(i, accel, field):
        field *= 1.05

    assert (flags_after(strengthen) & (FIELD_MAGNITUDE | FIELD_DIP) == FIELD_MAGNITUDE).all()


def test_wrong_dip_is_told():
    def steepen(i, accel, field):
        up = accel / np.linalg.norm(accel, axis=1, keepdims=True)
        field -= 10.0 * up
        field *= np.linalg.norm(FIELD_UT) / np.linalg.norm(field, axis=1, keepdims=True)

    assert (flags_after(steepen) & (FIELD_MAGNITUDE | FIELD_DIP) == FIELD_DIP).all()


def test_magnet_near_one_node_is_told_at_that_node():
    def disturb(i, accel, field):
        field[6] = field[6] @ np.array([[0.9, 0.4359, 0], [-0.4359, 0.9, 0], [0, 0, 1]])

    flags = flags_after(disturb)
    assert flags[6] & (FIELD_MAGNITUDE | FIELD_DIP)
    assert not flags[[0, 1, 2, 3, 10, 11, 12, 13, 14, 15]].any()


def test_field_that_turns_while_gravity_does_not_is_told():
    """A magnet brought near at 1 rad/s keeps magnitude and dip: only its speed gives it away."""

    def sweep(i, accel, field):
        up = accel[0] / np.linalg.norm(accel[0])
        angle = 0.01 * i
        along = (field @ up)[:, None] * up
        across = field - along
        field[:] = along + np.cos(angle) * across + np.sin(angle) * np.cross(up, across)

    assert (flags_after(sweep, scans=100) & FIELD_DIP).all()


def test_reset_forgets_everything():
    pair = twisted(np.random.default_rng(11), 0.1)
    other = twisted(np.random.default_rng(12), 0.1)
    fusion = Fusion(two_axes=True)
    expected = fusion.scan(*readings(*pair))
    for _ in range(20):
        fusion.scan(*readings(*other))
    fusion.reset()
    assert np.array_equal(fusion.scan(*readings(*pair)).q, expected.q)


def test_sigma_reaches_the_wire_rounded_up():
    code = lib.wire_sigma_code(np.radians(0.82))
    assert 0.05 * 10 ** (code / 5) >= 0.82 > 0.05 * 10 ** ((code - 1) / 5)
