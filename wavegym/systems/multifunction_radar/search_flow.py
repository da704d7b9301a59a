"""The equilibrium of search: the value of a find, and the least number of targets that a blind search leaves.

Undetected targets flow between cells, and a beam's searches take them at a rate that is proportional to its share of
the time. The cost of the equilibrium is a convex function of these shares. So is the mean cost of dwells one by one, at
whatever times: a search that finds the share p of a cell acts as the rate -ln(1 - p) over its duration, and the number
of targets that stay unfound is convex in the rates. Hence the best constant shares bound every order of dwells.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_array, diags_array
from scipy.sparse.linalg import splu

from wavegym.core.arrays import Array
from wavegym.systems.multifunction_radar.area_kernels import Area, drift_step, middle_of, weight_at

SURE = 1.0 - 1e-12  # share of the targets that a search finds at most, so that its rate is finite
DAMPING = 0.7  # exponent of the multiplicative algorithm
MOST_STEPS = 1000  # of it


class Search(NamedTuple):
    """An equilibrium of search; t trains, i beams, b range bins, c classes of cross section."""

    shares: Array  # (t, i) of the time
    undetected: Array  # (i, b, c) targets
    value: Array  # (i, b, c) s: what a find saves, until the target would have been found anyway or has left
    cost: float  # undetected targets, each with its weight
    least: float  # no shares cost less; by convexity


def flow_matrix(area: Area, shape: tuple[int, int]) -> tuple[csc_array, Array]:
    """Rates L (cell, cell) in 1/s and inflow s (cell,): without search, the numbers u of a class change by L u + s.

    The cells (i, b) are numbered beam by beam. The inflow is that of all classes together.
    """
    cells, scratch = int(np.prod(shape)), np.empty((*shape, 1))

    def step(numbers: Array) -> Array:
        after = numbers.reshape(scratch.shape).copy()
        drift_step(after, 1.0, area, scratch)
        return after.ravel() - numbers

    inflow = step(np.zeros(cells))
    return csc_array(np.transpose([step(unit) - inflow for unit in np.eye(cells)])), inflow


def best_search(area: Area, covers: Array, durations: Array, share: float, accuracy: float = 0.01) -> Search:
    """The equilibrium of least cost if a share of the time is searched.

    By the multiplicative algorithm (Silvey, Titterington and Torsney 1978): shares grow with what they save.

    Args:
        area: the region.
        covers: share of the targets in and beside beam i that a search with it finds, (t, i, 3, b, c).
        durations: of a search with each train, (t,) s.
        share: of the time, > 0.
        accuracy: relative difference of ``cost`` and ``least`` at which it ends.
    """
    _, beams, _, bins, classes = covers.shape
    rates = -np.log1p(-np.minimum(covers, SURE)) / durations[:, None, None, None, None]
    flow, inflow = flow_matrix(area, (beams, bins))
    weight = np.tile(weight_at(middle_of(np.arange(bins), bins, area), area), beams)
    shares = np.full(rates.shape[:2], share / rates[..., 0, 0, 0].size)
    undetected, value = np.empty((2, beams * bins, classes))
    for _ in range(MOST_STEPS):
        taken = _taken(shares, rates).reshape(-1, classes)
        for c in range(classes):
            solved = splu(csc_array(diags_array(taken[:, c]) - flow))
            undetected[:, c] = solved.solve(inflow / classes)
            value[:, c] = solved.solve(weight, "T")
        saved = _saved((undetected * value).reshape(beams, bins, classes), rates)
        cost, mean = float(weight @ undetected.sum(axis=1)), float((saved * shares).sum()) / share
        least = cost - share * (float(saved.max()) - mean)
        if cost - least <= accuracy * cost:
            break
        shares *= (saved / mean) ** DAMPING
        shares *= share / shares.sum()
    shape = beams, bins, classes
    return Search(shares, undetected.reshape(shape), value.reshape(shape), cost, least)


def _taken(shares: Array, rates: Array) -> Array:
    """Rate (i, b, c) at which targets are found in each cell."""
    beams = shares.shape[1]
    taken = np.zeros((beams + 2, *rates.shape[3:]))
    for n in range(3):
        taken[n : n + beams] += np.einsum("ti,tibc->ibc", shares, rates[:, :, n])
    return taken[1:-1]


def _saved(product: Array, rates: Array) -> Array:
    """Reduction of the cost per share of the time, (t, i); product: undetected targets times their values."""
    padded, beams = np.pad(product, ((1, 1), (0, 0), (0, 0))), len(product)
    return sum(np.einsum("tibc,ibc->ti", rates[:, :, n], padded[n : n + beams]) for n in range(3))
