"""Two tracks and one dwell: the rule by value against the best of all sequences of updates."""

from __future__ import annotations

import numpy as np

from wavegym.core import shortcuts, trees
from wavegym.core.worlds import draw_worlds
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

SYSTEM = MultifunctionRadar(settled=0.0, known=1.0, overhead=0.2, pulses=(48,), bursts=(1,))
DWELLS, WORLDS = 10, range(6)


def two_tracks(seed):
    """A belief in two tracks for certain, and that nothing is left to find; and their updates."""
    belief = SYSTEM.initial(draw_worlds(SYSTEM, [seed])).belief
    belief.existence[0, 2:], belief.existence[0, :2], belief.undetected[:] = 0.0, 1.0, 0.0
    return belief, SYSTEM.dwells.update(np.arange(2), np.zeros(2, np.int64))


def costs_of_all_sequences(belief, updates):
    """By the expected belief; the bits of a place are the numbers of the tracks, the first update in the highest."""
    cost = np.zeros(1)
    for _ in range(DWELLS):
        after = SYSTEM.predict(belief, np.tile(updates, (len(cost), 1)))
        belief = trees.tree_map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), after)
        cost = cost.repeat(len(updates)) + SYSTEM.cost(belief)
    return cost


def cost_of(choose, belief):
    total = 0.0
    for n in range(DWELLS):
        belief = SYSTEM.predict(belief, np.array([choose(belief, n)]))
        total += SYSTEM.cost(belief)[0]
    return total


def test_the_greatest_gain_per_second_comes_near_the_best_sequence_and_in_turn_does_not():
    by_value, in_turn = [], []
    for seed in WORLDS:
        belief, updates = two_tracks(seed)
        least = costs_of_all_sequences(belief, updates).min()

        def most_valued(belief, n, updates=updates):
            return updates[shortcuts.gain_per_second(SYSTEM, belief)[0, updates].argmax()]

        by_value.append(cost_of(most_valued, belief) / least - 1.0)
        in_turn.append(cost_of(lambda belief, n, updates=updates: updates[n % 2], belief) / least - 1.0)
    assert min(by_value) >= -1e-12
    assert min(in_turn) >= -1e-12
    assert np.mean(by_value) < 0.03
    assert np.mean(by_value) < 0.5 * np.mean(in_turn)


def test_the_costs_of_all_sequences_are_those_of_the_sequences():
    belief, updates = two_tracks(0)
    costs = costs_of_all_sequences(belief, updates)
    for place in (0, 1, 300, 2**DWELLS - 1):
        bits = [place >> (DWELLS - 1 - n) & 1 for n in range(DWELLS)]
        assert abs(cost_of(lambda belief, n, bits=bits: updates[bits[n]], belief) / costs[place] - 1.0) < 1e-12
