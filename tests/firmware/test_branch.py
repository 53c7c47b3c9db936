"""The choice between two solutions of every node: the cheapest of all 2^16 ways along the ribbon."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from ribbonhil._firmware import ffi, lib

NODES = lib.RIBBON_NODE_COUNT
TOLERANCE, COST_MAX = 0.3, 12.0


def choose(counts, costs, fields) -> list[int]:
    nodes = ffi.new("struct branch_node[]", NODES)
    for node, count, cost, field in zip(nodes, counts, costs, fields, strict=True):
        node.count, node.cost, node.field = int(count), cost.tolist(), field.tolist()
    chosen = ffi.new("uint8_t[]", NODES)
    lib.branch_choose(nodes, TOLERANCE, COST_MAX, chosen)
    return list(chosen)


def total(choice, counts, costs, fields) -> float:
    """What a choice costs, in double precision; steps skip nodes without solution."""
    used = [(costs[k][i], fields[k][i]) for k, i in enumerate(choice) if counts[k]]
    steps = [min(np.sum((a[1] - b[1]) ** 2) / TOLERANCE**2, COST_MAX) for a, b in itertools.pairwise(used)]
    return sum(cost for cost, _ in used) + sum(steps)


@pytest.mark.parametrize("seed", range(12))
def test_choice_is_the_cheapest_of_all(seed):
    """Within 1e-3 of the least total, found by trying every combination of the two-fold nodes."""
    rng = np.random.default_rng(seed)
    counts = rng.choice([0, 1, 2, 2], size=NODES)
    counts[np.flatnonzero(counts == 2)[9:]] = 1
    costs = rng.exponential(3.0, (NODES, 2))
    fields = rng.normal(size=(NODES, 2, 3)) * 0.4
    choice = choose(counts, costs, fields)
    ways = itertools.product(*[range(max(1, count)) for count in counts])
    assert total(choice, counts, costs, fields) <= min(total(w, counts, costs, fields) for w in ways) + 1e-3


def test_smooth_branch_wins_over_a_jumping_one_that_fits_a_little_better():
    smooth = np.stack([np.linspace(0, 1, NODES), np.zeros(NODES), np.full(NODES, 0.5)], -1)
    jumping = smooth * [1, 1, -1]
    fields = np.stack([smooth, jumping], axis=1)
    costs = np.tile([0.5, 0.0], (NODES, 1))
    costs[0] = [0.0, 40.0]
    assert choose([2] * NODES, costs, fields) == [0] * NODES


def test_ribbon_without_any_solution_is_left_alone():
    assert choose([0] * NODES, np.zeros((NODES, 2)), np.zeros((NODES, 2, 3))) == [0] * NODES
