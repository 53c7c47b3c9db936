"""Calibrates all sensors of a ribbon together from still poses on a straight bar.

On a straight bar every sensor of the ribbon has the same attitude, unknown but common. A pose p with attitude
R_p (world from bar) makes accelerometer i read  S_i R_p^T (0, 0, g) + b_i  and magnetometer k read
T_k R_p^T B + h_k, where B is the local field, S_i and T_k hold scale, cross-axis, soft iron and mounting,
b_i and h_k bias and hard iron. All S, b, T, h, the attitudes and the dip angle are found together by
Gauss-Newton on the sparse normal equations. What no pose can tell, a rotation common to all sensors against
the ribbon, is held by the prior that mountings scatter around nominal.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ribbonhost.calibrate.bar_problem import Problem, State
from ribbonhost.calibrate.sensor_errors import Array, Poses, Prior, Solution
from ribbonhost.errors import CalibrationError

MAX_ITERATIONS = 60
MAX_REHEADINGS = 8
CONVERGED_STEP = 1e-9  # in prior standard deviations and radians


def solve(poses: Poses, prior: Prior | None = None) -> Solution:
    """Finds all sensor parameters and the attitudes of the poses.

    Raises CalibrationError when the poses do not determine them (numerically singular or no convergence).
    """
    prior = prior or Prior()
    problem = Problem(poses, prior)
    results = []
    for start in problem.initial_states():
        result = _descend(problem, start)
        # With two axes a single pose can sit on the wrong one of two headings: the solved sensors tell.
        for _ in range(MAX_REHEADINGS):
            turned = problem.best_headings(result[0])
            if turned is None:
                break
            again = _descend(problem, turned)
            if float(again[1] @ again[1]) >= float(result[1] @ result[1]):
                break
            result = again
        results.append(result)
    state, residual, jacobian = min(results, key=lambda result: float(result[1] @ result[1]))
    if not np.all(np.isfinite(residual)):
        raise CalibrationError(
            "the poses do not determine the calibration: turn the bar through more attitudes"
        )
    return problem.solution(state, residual, jacobian)


def _descend(problem: Problem, state: State) -> tuple[State, Array, sp.csr_array]:
    """Levenberg-Marquardt from one starting point."""
    damping = 1e-3
    residual, jacobian = problem.linearise(state)
    cost = float(residual @ residual)
    for _ in range(MAX_ITERATIONS):
        normal = (jacobian.T @ jacobian).tocsc()
        gradient = jacobian.T @ residual
        step = splu(normal + damping * sp.diags(normal.diagonal()).tocsc()).solve(-gradient)
        trial = problem.moved(state, step)
        new_residual, new_jacobian = problem.linearise(trial)
        new_cost = float(new_residual @ new_residual)
        if new_cost <= cost:
            state, residual, jacobian, cost = trial, new_residual, new_jacobian, new_cost
            damping *= 0.1
            if float(np.max(np.abs(step))) < CONVERGED_STEP:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return state, residual, jacobian
