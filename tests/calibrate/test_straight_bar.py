"""All sensors of a ribbon are calibrated together from poses on a straight bar."""

import numpy as np
import pytest
from numpy.typing import NDArray
from ribbonhost.calibrate.sensor_errors import STANDARD_GRAVITY_MPS2, Poses, matrix_basis
from ribbonhost.calibrate.straight_bar import solve
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

POSES, SENSORS = 24, 16
FIELD_UT = 48.0
DIP_RAD = np.radians(62.0)
ACCEL_SIGMA_MPS2, FIELD_SIGMA_UT = 1e-3, 0.02
LARGEST_SIGMAS = 4.5
"""Of some 400 parameters the largest error is beyond 4 standard deviations once in 40 draws."""


def drawn(seed: int, axes: int) -> tuple[Poses, Array]:
    """Poses of a ribbon whose parts have errors drawn by seed, and the true parameters as Solution.values."""
    random = np.random.default_rng(seed)
    spread = {"scale": 0.01, "cross": 0.005, "mounting": 0.0175}

    def deviations(names: tuple[str, ...]) -> Array:
        return random.normal(size=(SENSORS, len(names))) * [spread[name.split("_")[0]] for name in names]

    accel_basis, accel_names = matrix_basis(3)
    field_basis, field_names = matrix_basis(axes)
    accel, field = deviations(accel_names), deviations(field_names)
    accel_bias = 0.2 * random.normal(size=(SENSORS, 3))
    hard_iron = 15 * random.normal(size=(SENSORS, axes))
    attitude = Rotation.random(POSES, rng=random).as_matrix()
    up = attitude[:, 2] * STANDARD_GRAVITY_MPS2
    b = np.einsum("pji,j->pi", attitude, FIELD_UT * np.array([0, np.cos(DIP_RAD), -np.sin(DIP_RAD)]))
    accel_matrix = np.eye(3) + np.einsum("nk,kij->nij", accel, accel_basis)
    field_matrix = np.eye(3)[:axes] + np.einsum("nk,kij->nij", field, field_basis)
    accel_mps2 = np.einsum("nij,pj->pni", accel_matrix, up) + accel_bias
    field_ut = np.einsum("nij,pj->pni", field_matrix, b) + hard_iron
    poses = Poses(
        accel_mps2 + ACCEL_SIGMA_MPS2 * random.normal(size=accel_mps2.shape),
        field_ut + FIELD_SIGMA_UT * random.normal(size=field_ut.shape),
        ACCEL_SIGMA_MPS2,
        FIELD_SIGMA_UT,
        FIELD_UT,
    )
    true = np.r_[np.c_[accel, accel_bias].ravel(), np.c_[field, hard_iron].ravel(), DIP_RAD]
    return poses, true


@pytest.mark.parametrize(("seed", "axes"), [(2, 2), (3, 3)])
def test_parameters_are_found_within_their_stated_sigmas(seed: int, axes: int) -> None:
    poses, true = drawn(seed, axes)
    solution = solve(poses)
    sigma = np.sqrt(np.diag(solution.covariance))
    assert solution.chi2_per_dof == pytest.approx(1.0, abs=0.15)
    assert np.abs((solution.values - true) / sigma).max() < LARGEST_SIGMAS
    assert np.degrees(abs(solution.parameters.dip_rad - DIP_RAD)) < 0.05
    assert len(solution.names) == len(solution.values)


def test_mountings_relative_to_each_other_are_exact_to_hundredths_of_a_degree() -> None:
    poses, true = drawn(5, 2)
    solution = solve(poses)
    error = solution.values - true
    for axis in "xyz":
        of_axis = np.array([name.endswith(f"mounting_{axis}") for name in solution.names])
        assert np.degrees(np.std(error[of_axis])) < 0.05


def test_a_sensor_that_disagrees_stands_out_in_the_residuals() -> None:
    poses, _ = drawn(1, 2)
    poses.accel_mps2[:, 4] += 0.3 * np.random.default_rng(9).normal(size=(POSES, 3))
    solution = solve(poses)
    per_sensor = np.sqrt(np.mean(solution.accel_residual**2, axis=(0, 2)))
    assert np.argmax(per_sensor) == 4
    assert per_sensor[4] > 5 * np.median(per_sensor)
