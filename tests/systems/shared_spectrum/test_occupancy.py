"""Predictors of the occupancy against plain Python of their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from wavegym.core.errors import InputError
from wavegym.sensors import contiguous_bands
from wavegym.systems.shared_spectrum.occupancy import MEMORY, predictor_of
from wavegym.systems.shared_spectrum.occupancy_kernels import SURE

LOUD = 30  # half decibels
BANDS = contiguous_bands(3)


def heard(rng, steps, channels=3):
    """Noise (1, T, channel) of channels that are free or occupied, with some memory."""
    busy = np.zeros((steps, channels), np.int64)
    for k in range(1, steps):
        flips = rng.random(channels) < np.where(busy[k - 1], 0.3, 0.4)
        busy[k] = np.where(flips, 1 - busy[k - 1], busy[k - 1])
    return (LOUD * busy).astype(np.uint8)[None], busy


def predicted(name, noise, length, gap=1):
    return predictor_of(name, BANDS)(noise, np.full((1, noise.shape[1]), -1, np.int16), np.array([length]), gap)[0]


def estimate(ones, zeros):
    """Krichevsky and Trofimov's."""
    return (ones + 0.5) / (ones + zeros + 1.0)


@pytest.mark.parametrize("gap", [1, 3])
def test_counts_and_markov(gap):
    noise, busy = heard(np.random.default_rng(0), 40)
    n = 30
    np.testing.assert_allclose(predicted("counts", noise, n, gap), (busy[:n].sum(axis=0) + 0.5) / (n + 1))
    for c, found in enumerate(predicted("markov", noise, n, gap)):
        past = busy[:n, c]
        after = [past[k + gap] for k in range(n - gap) if past[k] == past[-1]]
        assert found == pytest.approx(estimate(sum(after), len(after) - sum(after)))


def log_probability(sequence):
    """ln of the Krichevsky-Trofimov probability of a sequence of bits."""
    ones, zeros, total = 0, 0, 0.0
    for bit in sequence:
        p = estimate(ones, zeros)
        total += math.log(p if bit else 1.0 - p)
        ones, zeros = ones + bit, zeros + 1 - bit
    return total


def weighted(past, steps, depth, gap, context=()):
    """Willems' recursion: half the estimator of a node, half the product of its children; by enumeration."""

    def bit(k, d):
        return past[k - gap - d] if k - gap - d >= 0 else 0

    here = [k for k in steps if all(bit(k, d) == want for d, want in enumerate(context))]
    own = log_probability([past[k] for k in here])
    if len(context) == depth:
        return own
    children = sum(weighted(past, here, depth, gap, (*context, value)) for value in (0, 1))
    return float(np.logaddexp(own, children) - math.log(2.0))


@pytest.mark.parametrize(("depth", "gap"), [(1, 1), (3, 1), (3, 2)])
def test_context_tree_weighting_is_the_ratio_of_two_weighted_probabilities(depth, gap):
    noise, busy = heard(np.random.default_rng(1), 30)
    n = 24
    for c, found in enumerate(predicted(f"context-tree:{depth}", noise, n, gap)):
        past = busy[:n, c].tolist()
        next_step = n - 1 + gap  # the steps between are not known, and in no context
        longer = [*past, *[0] * (gap - 1), 1]
        steps = list(range(gap, n))
        ratio = weighted(longer, [*steps, next_step], depth, gap) - weighted(longer, steps, depth, gap)
        assert found == pytest.approx(math.exp(ratio), rel=1e-9)


@pytest.mark.parametrize("gap", [1, 2])
def test_lags_are_mixed_by_their_likelihood(gap):
    noise, busy = heard(np.random.default_rng(2), 60)
    n, most = 50, 6
    for c, found in enumerate(predicted(f"lags:{most}", noise, n, gap)):
        past, weights, chances = busy[:n, c], [], []
        for lag in range(gap, most + 1):
            counts, log = {0: [0, 0], 1: [0, 0]}, 0.0
            for k in range(lag, n):
                seen = counts[past[k - lag]]
                p = estimate(seen[1], seen[0])
                if k >= most:
                    log = MEMORY * log + math.log(p if past[k] else 1.0 - p)
                seen[past[k]] += 1
            last = counts[past[n - 1 + gap - lag]]
            weights.append(log)
            chances.append(estimate(last[1], last[0]))
        share = np.exp(np.array(weights) - max(weights))
        assert found == pytest.approx((share * chances).sum() / share.sum(), rel=1e-9)


def test_lags_learn_a_period_and_stepped_users_are_followed():
    steps = np.arange(60)
    periodic = np.zeros((1, 60, 8), np.uint8)
    periodic[0, steps % 5 == 0, 2] = LOUD
    for length, wanted in ((55, 1.0), (56, 0.0)):
        assert predicted("lags:10", periodic, length)[2] == pytest.approx(wanted, abs=0.15)
    moving = np.zeros((1, 60, 8), np.uint8)
    turn = np.where(steps < 30, 3 * steps, 90 - 2 * (steps - 30)) % 8  # another stride after the 30th step
    moving[0, steps, turn] = LOUD
    at = turn[34]
    followed, by_lags = (predicted(name, moving, 34)[at] for name in ("stepped:10", "lags:10"))
    assert followed > 0.9 > 0.5 > by_lags


@pytest.mark.parametrize("gap", [1, 2])
@pytest.mark.parametrize("width", [1, 2])
@pytest.mark.parametrize("stride", [-3, 2])
def test_a_stepped_user_leaves_the_history_of_the_others(stride, width, gap):
    """Beside a user that stays: the chains are those without the stepped user, and its next place is added."""
    steps, n, room = np.arange(40), 33, 8 - width + 1
    others = np.zeros((1, 40, 8), np.uint8)
    others[0, :, 6] = LOUD
    noise, place = others.copy(), (1 + stride * steps) % room
    for c in range(width):
        noise[0, steps, place + c] = LOUD
    found, alone = (predicted(name, history, n, gap) for name, history in (("stepped:6", noise), ("lags:6", others)))
    next_place = place[n - 1 + gap]
    for c in range(8):
        is_next = next_place <= c < next_place + width
        expected = 1.0 - (1.0 - SURE) * (1.0 - alone[c]) if is_next else alone[c]
        assert found[c] == pytest.approx(expected, rel=1e-12)


def test_two_stepped_users_are_followed_through_each_other():
    steps, noise = np.arange(40), np.zeros((1, 40, 8), np.uint8)
    for stride, first in ((2, 1), (-3, 4)):
        noise[0, steps, (first + stride * steps) % 8] = LOUD
    for n in range(30, 38):
        found = predicted("stepped:6", noise, n)
        assert ((found > 0.9) == (noise[0, n] == LOUD)).all()


def test_reactions_are_markov_chains_with_the_radars_band_in_the_context():
    rng = np.random.default_rng(5)
    noise, busy = heard(rng, 50)
    listened, n = 10, 45
    sent = rng.integers(len(BANDS.first), size=(1, 40)).astype(np.int16)
    found = predictor_of("reactions", BANDS)(noise, sent, np.array([n]), 1)[0]
    for c in range(3):
        held = [k >= listened and BANDS.share[sent[0, k - listened], c] > 1e-9 for k in range(n)]
        after = [busy[k + 1, c] for k in range(n - 1) if (busy[k, c], held[k]) == (busy[n - 1, c], held[n - 1])]
        assert found[c] == pytest.approx(estimate(sum(after), len(after) - sum(after)))


@pytest.mark.parametrize("name", ["lags:2", "stepped:2"])
def test_a_gap_beyond_the_longest_lag_leaves_one_chain(name):
    noise, busy = heard(np.random.default_rng(6), 40)
    for c, found in enumerate(predicted("lags:2", noise, 30, 5)):
        past = busy[:30, c]
        after = [past[k + 5] for k in range(25) if past[k] == past[-1]]
        assert found == pytest.approx(estimate(sum(after), len(after) - sum(after)))
    assert np.isfinite(predicted(name, noise, 30, 5)).all()


def test_names():
    with pytest.raises(InputError, match=r"predictor is 'contexttree', expected one of .*'context-tree'"):
        predictor_of("contexttree", BANDS)
    with pytest.raises(
        InputError, match=r"predictor is 'lags', expected lags: and 1 to 100 steps \(nearest: 'lags:10'\)"
    ):
        predictor_of("lags", BANDS)
    with pytest.raises(InputError, match="predictor is 'context-tree:13', expected context-tree: and 1 to 12 steps"):
        predictor_of("context-tree:13", BANDS)
    with pytest.raises(InputError, match="predictor is 'markov:2', expected 'markov', which has no number"):
        predictor_of("markov:2", BANDS)
