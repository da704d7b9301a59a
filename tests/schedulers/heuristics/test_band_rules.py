"""Rules for a shared band, on beliefs written by hand."""

from __future__ import annotations

import pickle

import numpy as np
import oracles
import pytest

from wavegym.core.errors import InputError
from wavegym.schedulers.heuristics.band_rules import (
    Claim,
    MultiObjective,
    SenseAndAvoid,
    SenseAndHold,
    Thompson,
    UpperConfidence,
)
from wavegym.schedulers.rollout import rollout
from wavegym.systems.shared_spectrum import SharedSpectrum

LOUD = 40  # half decibels: 20 dB
STEPS = 6


def choice(rule, occupied, last=None):
    """The channels of the band that the rule takes, after steps in which these channels were occupied."""
    system = SharedSpectrum(horizon=20, history=4)
    belief = system.initial(oracles.worlds(system, 1)).belief
    belief.heard[:] = 0
    for k, channels in enumerate(occupied):
        belief.heard[0, 4 + STEPS - len(occupied) + k, list(channels)] = LOUD
    belief = belief._replace(step=np.array([STEPS]))
    if last is not None:
        first, width = last
        belief.sent[0, STEPS - 1] = np.flatnonzero((system.bands.first == first) & (system.bands.width == width))[0]
    rule.begin(system, 1, np.random.default_rng(0))
    return np.flatnonzero(system.held[rule.act(belief, None, None)[0]]).tolist()


def test_sense_and_avoid_takes_the_widest_clear_band():
    assert choice(SenseAndAvoid(), [{2}]) == [3, 4, 5, 6, 7]
    assert choice(SenseAndAvoid(), [{6}, {2}]) == [3, 4, 5, 6, 7]
    assert choice(SenseAndAvoid(window=2), [{6}, {2}]) == [3, 4, 5]
    assert choice(SenseAndAvoid(widest=2), [{0}]) in ([1, 2], [3, 4], [5, 6], [6, 7])
    assert choice(SenseAndAvoid(), [set(range(8))]) == list(range(8))


def test_hysteresis_keeps_a_clear_band():
    assert choice(SenseAndHold(), [{3}], last=(0, 3)) == [4, 5, 6, 7]
    assert choice(SenseAndHold(keep=1), [{3}], last=(0, 3)) == [0, 1, 2]
    assert choice(SenseAndHold(keep=1), [{1}], last=(0, 3)) == [2, 3, 4, 5, 6, 7]


def test_a_claim_outlasts_a_collision():
    assert choice(Claim(width=3, patience=2, window=2), [{0}, {4}], last=(4, 3)) == [4, 5, 6]
    assert choice(Claim(width=3, patience=2, window=2), [{4}, {4}], last=(4, 3)) == [0, 1, 2]
    assert choice(Claim(width=3, patience=1, window=2), [{0}, {4}], last=(4, 3)) == [1, 2, 3]


def test_the_weight_trades_bandwidth_for_sinr():
    assert choice(MultiObjective(weight=0.0), [{0}]) == list(range(8))
    assert choice(MultiObjective(weight=0.5), [{0}]) == list(range(1, 8))
    assert len(choice(MultiObjective(weight=1.0), [{0}])) == 1


def test_bandits_take_channels_that_were_seldom_occupied():
    busy = [set(range(1, 8))] * STEPS
    assert choice(UpperConfidence(window=6), busy) == [0]
    assert choice(Thompson(window=6), busy) == [0]
    assert len(choice(UpperConfidence(window=6), [set()] * STEPS)) == 8


@pytest.mark.parametrize(
    "rule", [SenseAndAvoid(), SenseAndHold(2, 1, 4), Claim(), MultiObjective(), Thompson(), UpperConfidence()]
)
def test_rules_play_and_can_be_sent_to_other_processes(rule):
    system = SharedSpectrum(horizon=20, history=4)
    worlds = oracles.worlds(system, 5)
    cost = rollout(system, rule, worlds).cost
    np.testing.assert_array_equal(rollout(system, pickle.loads(pickle.dumps(rule)), worlds).cost, cost)


def test_constants_out_of_range_are_refused():
    for made, wanted in (
        (lambda: SenseAndAvoid(window=0), "window is 0"),
        (lambda: SenseAndAvoid(keep=-1), "keep is -1"),
        (lambda: Claim(patience=0), "patience is 0"),
        (lambda: MultiObjective(weight=1.5), r"weight is 1\.5"),
        (lambda: Thompson(window=0), "window is 0"),
        (lambda: UpperConfidence(optimism=-1.0), r"optimism is -1\.0"),
    ):
        with pytest.raises(InputError, match=wanted):
            made()
