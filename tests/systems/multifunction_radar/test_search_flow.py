"""The equilibrium of search, against the drift and the thinning of the belief, step by step."""

from __future__ import annotations

import numpy as np
import pytest

from wavegym.systems.multifunction_radar import MultifunctionRadar
from wavegym.systems.multifunction_radar.area_kernels import drift, thin
from wavegym.systems.multifunction_radar.search_flow import best_search, flow_matrix

SYSTEM = MultifunctionRadar(priority=3.0)
AREA, COVERS = SYSTEM.area, SYSTEM.menu.covers
DURATIONS = np.array(SYSTEM.dwells.seconds) + SYSTEM.overhead
SHARE = 0.5
FOUND = best_search(AREA, COVERS, DURATIONS, SHARE, 0.002)
SHAPE = FOUND.value.shape
WEIGHT = np.linspace(3.0, 1.0, 15)[1::2]  # in the middles of the seven bins


def moved(numbers, seconds):
    after = numbers.copy()
    drift(after, seconds, AREA, np.empty_like(after))
    return after


def cost(numbers):
    return (WEIGHT[:, None] * numbers).sum()


def test_the_flow_is_that_of_the_belief():
    flow, inflow = flow_matrix(AREA, SHAPE[:2])
    usual = SYSTEM.usual_numbers
    np.testing.assert_allclose(flow @ usual.ravel(), -inflow, atol=1e-12)  # without search the numbers stay
    numbers = usual[:, :, None] * np.random.default_rng(0).random((*SHAPE[:2], 1))
    step = 1e-4
    want = numbers.ravel() + step * (flow @ numbers.ravel() + inflow)
    np.testing.assert_allclose(moved(numbers, step).ravel(), want, rtol=1e-6)


def test_shares_are_of_the_time_and_no_better_ones_are_far():
    assert FOUND.shares.min() >= 0.0
    assert FOUND.shares.sum() == pytest.approx(SHARE, rel=1e-12)
    assert 0.998 * FOUND.cost <= FOUND.least <= FOUND.cost == pytest.approx(cost(FOUND.undetected), rel=1e-12)
    better = best_search(AREA, COVERS, DURATIONS, SHARE, 1e-4)
    assert FOUND.least < better.cost < FOUND.cost


@pytest.mark.parametrize("cell", [(0, 6, 0), (36, 6, 0), (36, 3, 2), (60, 0, 1)])
def test_the_value_of_a_find_is_what_its_target_would_have_cost(cell):
    """Added to the equilibrium and followed until nothing of it is left, in steps of 0.02 s."""
    rates = -np.log1p(-COVERS) / DURATIONS[:, None, None, None, None]
    taken = np.zeros(SHAPE)
    for train, i in np.ndindex(FOUND.shares.shape):
        for n in range(3):
            if 0 <= i + n - 1 < SHAPE[0]:
                taken[i + n - 1] += FOUND.shares[train, i] * rates[train, i, n]
    with_it, without, step = FOUND.undetected.copy(), FOUND.undetected.copy(), 0.02
    with_it[cell] += 1.0
    kept, total, extra = np.exp(-step * taken), 0.0, 1.0
    while extra > 1e-3:
        before = cost(with_it) - cost(without)
        with_it, without = moved(with_it, step) * kept, moved(without, step) * kept
        total += 0.5 * step * (before + cost(with_it) - cost(without))
        extra = (with_it - without).sum()
    assert FOUND.value[cell] == pytest.approx(total, rel=0.02)


def by_value(numbers, rng):
    """The search of the greatest gain per second, of any beam."""
    gain, worth = np.zeros(FOUND.shares.shape), np.pad(numbers * FOUND.value, ((1, 1), (0, 0), (0, 0)))
    for n in range(3):
        gain += np.einsum("tibc,ibc->ti", COVERS[:, :, n], worth[n : n + SHAPE[0]])
    return np.unravel_index((gain / DURATIONS[:, None]).argmax(), gain.shape)


def at_random(numbers, rng):
    return np.divmod(rng.choice(FOUND.shares.size, p=FOUND.shares.ravel() / SHARE), SHAPE[0])


def only_the_outer_beams(numbers, rng):
    return 2, rng.choice([0, 1, 2, 69, 70, 71])


@pytest.mark.parametrize(
    ("choose", "at_most"),
    [(by_value, 1.1), (at_random, 1.4), (only_the_outer_beams, np.inf)],
    ids=lambda x: str(x)[:20],
)
def test_no_order_of_searches_leaves_fewer(choose, at_most):
    """Over 60 s after 20 s; a good order comes near the bound."""
    numbers, time, total, rng = FOUND.undetected.copy(), 0.0, 0.0, np.random.default_rng(0)
    while time < 80.0:
        train, i = choose(numbers, rng)
        seconds = DURATIONS[train] / SHARE
        before, numbers = cost(numbers), moved(numbers, seconds)
        total += 0.5 * seconds * (before + cost(numbers)) * (time > 20.0)
        thin(numbers, i, COVERS[train, i])
        time += seconds
    assert FOUND.least <= total / 60.0 <= at_most * FOUND.least
