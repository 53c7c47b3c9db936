"""Where the search for the sensors of a straight bar starts: attitudes of the poses without calibration."""

import numpy as np

from ribbonhost.calibrate.bar_problem import Problem, State
from ribbonhost.calibrate.rotations import about_up, field_world_ut, with_up
from ribbonhost.calibrate.sensor_errors import Array, Parameters, Poses

DIPS_DEG = (-70.0, -45.0, -15.0, 15.0, 45.0, 60.0, 70.0)


def tilts(poses: Poses) -> Array:
    """(P, 3, 3) attitudes of any heading, from the mean of all accelerometers."""
    up = poses.accel_mps2.mean(axis=1)
    up = up / np.linalg.norm(up, axis=1)[:, None]
    return np.array([with_up(u) for u in up])


def initial_states(problem: Problem, starts_kept: int, dip_rad: float | None = None) -> list[State]:
    """Starting points: nominal sensors, tilt from the mean of all accelerometers, headings by search.

    dip_rad: a dip to try besides the usual ones.
    The hard iron common to all magnetometers is searched on a grid, and for each value the heading of
    each pose: with it wrong the alternation of the two stops in side minima. The best few are worth a
    descent each.
    """
    poses, axes = problem.poses, problem.poses.axes
    mean_field = poses.field_ut.mean(axis=1)
    attitudes = np.einsum("tij,pjk->ptik", about_up(72), tilts(poses))

    centre = mean_field.mean(axis=0)
    # A step that is a fraction of the field finds the basin; two finer grids go down in it.
    steps = {2: 13, 3: 7}[axes]
    radius_ut = poses.field_strength_ut
    radii_ut = (radius_ut, radius_ut * 2 / steps, radius_ut * 4 / steps**2)
    starts: list[tuple[float, Array, Array, float]] = []
    dips = np.radians(DIPS_DEG) if dip_rad is None else np.append(np.radians(DIPS_DEG), dip_rad)
    for dip in dips:
        field = np.einsum("ptji,j->pti", attitudes, field_world_ut(poses.field_strength_ut, dip))[..., :axes]
        offset, cost = centre[None], np.zeros(1)
        for radius in radii_ut:
            line = np.linspace(-radius, radius, steps)
            box = np.stack(np.meshgrid(*[line] * axes, indexing="ij"), axis=-1).reshape(-1, axes)
            offset = offset[np.argmin(cost)] + box
            cost = np.zeros(len(offset))
            for p in range(len(poses)):
                error = mean_field[p] - offset[:, None] - field[p]
                cost += np.einsum("oti,oti->ot", error, error).min(axis=1)
        best = offset[np.argmin(cost)]
        heading = np.argmin(np.sum((mean_field[:, None] - best - field) ** 2, axis=2), axis=1)
        starts.append((float(cost.min()), best, heading, float(dip)))
    starts.sort(key=lambda start: start[0])
    states = []
    for _, _, heading, dip in starts[:starts_kept]:
        r = attitudes[np.arange(len(poses)), heading]
        seen = np.einsum("pji,j->pi", r, field_world_ut(poses.field_strength_ut, dip))[:, :axes]
        states.append(problem.state(r, dip, np.mean(poses.field_ut - seen[:, None], axis=0)))
    return states


def with_headings(poses: Poses, parameters: Parameters, r_world_bar: Array) -> tuple[Array, Array]:
    """Attitudes turned about the vertical to where all magnetometers fit best, and by how many 2 degree
    steps (-90 ... 89) each was turned.
    """
    turns = about_up(180)
    candidates = np.einsum("tij,pjk->ptik", turns, r_world_bar)
    world_ut = field_world_ut(poses.field_strength_ut, parameters.dip_rad)
    field = np.einsum("ptji,j->pti", candidates, world_ut)
    predicted = np.einsum("nij,ptj->ptni", parameters.field_matrix, field) + parameters.field_bias_ut
    cost = np.sum((predicted - poses.field_ut[:, None]) ** 2, axis=(2, 3))
    best = np.argmin(cost, axis=1)
    steps = (best + len(turns) // 2) % len(turns) - len(turns) // 2
    return candidates[np.arange(len(poses)), best], steps


def best_headings(problem: Problem, state: State) -> State | None:
    """The state with each pose turned to where all magnetometers fit best; None if none turns."""
    turned, steps = with_headings(problem.poses, problem.parameters(state), state.r_world_bar)
    far = np.abs(steps) > 2
    if not far.any():
        return None
    r = np.where(far[:, None, None], turned, state.r_world_bar)
    return State(state.accel, state.field, r, state.swing, state.table, state.dip_rad)
