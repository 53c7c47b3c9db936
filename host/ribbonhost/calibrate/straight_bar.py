"""Calibrates all sensors of a ribbon together from still poses on a straight bar.

On a straight bar every sensor of the ribbon has the same attitude, unknown but common. A pose p with attitude
R_p (world from bar) makes accelerometer i read  S_i R_p^T (0, 0, g) + b_i  and magnetometer k read
T_k R_p^T B + h_k, where B is the local field, S_i and T_k hold scale, cross-axis, soft iron and mounting,
b_i and h_k bias and hard iron. All S, b, T, h, the attitudes and the dip angle are found together by
Gauss-Newton from a sparse Jacobian. What is left of the hand's acceleration is an unknown of each
pose, as far as it is known to be there.

What no held pose can tell is a rotation common to all sensors against the bar. Poses in which the bar lies on
a table tell it: a side that lies flat is parallel to the same plane before and after the bar is turned end
for end, however the table tilts, as with a spirit level. Without them it is held by the prior that mountings
scatter around nominal.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from ribbonhost.calibrate.bar_problem import Problem, State
from ribbonhost.calibrate.bar_start import best_headings, initial_states, tilts, with_headings
from ribbonhost.calibrate.sensor_errors import Array, Parameters, Poses, Prior, Solution
from ribbonhost.errors import CalibrationError

MAX_ITERATIONS = 40
MAX_REHEADINGS = 4
CONVERGED_STEP = 1e-6  # in prior standard deviations and radians
CONVERGED_COST = 1e-7  # of the sum of squares
ROUGH_ROUNDS = 8
DOUBTING_ROUNDS = 12
TRIMMINGS = 4
OUT_OF_LINE = 16.0
ROUGH_ITERATIONS = 8
FAR_OFF = 3.0
"""A pose whose field fits worse than that of most by this factor counts half at first."""
STARTS = (1, 8)
"""How many starting points are tried, and how many in all if none of the first explains the readings."""
CHI2_EXPLAINED = 1.8

_Result = tuple[State, Array, sp.csr_array]


def solve(poses: Poses, prior: Prior | None = None, dip_rad: float | None = None) -> Solution:
    """Finds all sensor parameters and the attitudes of the poses; dip_rad: where the dip may be looked for.

    Raises CalibrationError when the poses do not determine them (numerically singular or no convergence).
    """
    problem = Problem(poses, prior or Prior())
    states = initial_states(problem, STARTS[1], dip_rad)
    best = _best(problem, states[: STARTS[0]])
    if problem.solution(*best).chi2_per_dof > CHI2_EXPLAINED:
        best = min(best, _best(problem, states[STARTS[0] :]), key=_cost)
    return problem.solution(*best)


def refine(poses: Poses, start: Parameters, prior: Prior) -> Solution:
    """Moves parameters that are known, by no more than the prior lets them, to where they explain the poses.

    Raises CalibrationError as `solve`.
    """
    problem = Problem(poses, prior, start)
    r, _ = with_headings(poses, start, tilts(calibrated(poses, start)))
    best = _with_headings(problem, problem.state(r, start.dip_rad))
    if not np.all(np.isfinite(best[1])):
        raise _undetermined()
    return problem.solution(*best)


def solve_again(
    poses: Poses, solution: Solution, which: NDArray[np.bool_], prior: Prior | None = None
) -> Solution:
    """What some of the poses (P,) tell by themselves; the search starts from what all of them told."""
    problem = Problem(poses.part(which), prior or Prior())
    return problem.solution(*_descend(problem, problem.state_of(solution, which)))


def robust_field_cost(poses: Poses, solution: Solution, prior: Prior | None = None) -> Array:
    """(P, M) mean squares by which the field misses in each pose, in standard deviations, where poses that do
    not fit the others count for little.
    """
    problem = Problem(poses, prior or Prior())
    state = problem.state_of(solution, np.ones(len(poses), dtype=bool))
    if np.mean(solution.field_residual**2) < CHI2_EXPLAINED**2:
        return problem.field_cost(state)
    state = _roughly(problem, initial_states(problem, 1)[0], DOUBTING_ROUNDS)
    for _ in range(TRIMMINGS):
        cost = np.median(problem.field_cost(state), axis=1)
        weight = np.where(cost > OUT_OF_LINE * np.median(cost), 1e-9, 1.0)
        state = _descend(problem.with_field_weights(weight), state)[0]
        state = best_headings(problem, state) or state
    return problem.field_cost(state)


def calibrated(poses: Poses, parameters: Parameters) -> Poses:
    """The poses with their accelerometers as the parameters say that they should read."""
    inverse = np.linalg.inv(parameters.accel_matrix)
    accel: Array = np.einsum("aij,paj->pai", inverse, poses.accel_mps2 - parameters.accel_bias_mps2)
    return Poses(accel, poses.field_ut, poses.accel_sigma_mps2, poses.field_sigma_ut, poses.field_strength_ut)


def _best(problem: Problem, states: list[State]) -> _Result:
    result = min((_with_headings(problem, start) for start in states), key=_cost)
    if not np.all(np.isfinite(result[1])):
        raise _undetermined()
    return result


def _undetermined() -> CalibrationError:
    return CalibrationError("the poses do not determine the calibration: turn the bar through more attitudes")


def _cost(result: _Result) -> float:
    cost = float(result[1] @ result[1])
    return cost if np.isfinite(cost) else np.inf


def _with_headings(problem: Problem, start: State) -> _Result:
    """A descent; with two axes a pose can sit on the wrong one of two headings, which solved sensors tell."""
    result = _descend(problem, _roughly(problem, start, 0))
    for _ in range(MAX_REHEADINGS):
        turned = best_headings(problem, result[0])
        if turned is None:
            break
        again = _descend(problem, turned)
        if _cost(again) >= _cost(result):
            break
        result = again
    return result


def _roughly(problem: Problem, state: State, rounds_min: int) -> State:
    """A descent in which poses whose field fits worse than that of most count for little, lest they spoil
    the sensors that must tell which heading is right.
    """
    for count in range(max(ROUGH_ROUNDS, rounds_min)):
        cost = np.median(problem.field_cost(state), axis=1)
        weight = 1.0 / (1.0 + cost / (FAR_OFF * np.median(cost))) ** (1 if count < ROUGH_ROUNDS // 2 else 2)
        state = _descend(problem.with_field_weights(weight), state, ROUGH_ITERATIONS)[0]
        turned = best_headings(problem, state)
        if turned is None and count + 1 >= rounds_min:
            break
        state = turned or state
    return state


def _descend(problem: Problem, state: State, iterations: int = MAX_ITERATIONS) -> _Result:
    """Levenberg-Marquardt from one starting point."""
    damping = 1e-3
    residual, jacobian = problem.linearise(state)
    cost = float(residual @ residual)
    for _ in range(iterations):
        normal = (jacobian.T @ jacobian).toarray()
        gradient = jacobian.T @ residual
        damped = normal + damping * np.diag(normal.diagonal())
        # Six hundred unknowns, half of them in every other's company: dense is faster than sparse.
        try:
            step = cho_solve(cho_factor(damped, overwrite_a=True, check_finite=False), -gradient)
        except np.linalg.LinAlgError:
            damping *= 10.0
            continue
        trial = problem.moved(state, step)
        new_residual, new_jacobian = problem.linearise(trial)
        new_cost = float(new_residual @ new_residual)
        if new_cost <= cost:
            gained = cost - new_cost
            state, residual, jacobian, cost = trial, new_residual, new_jacobian, new_cost
            damping *= 0.1
            if float(np.max(np.abs(step))) < CONVERGED_STEP or gained < CONVERGED_COST * cost:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return state, residual, jacobian
