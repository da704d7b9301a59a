"""Random, fixed and round robin."""

from __future__ import annotations

import numpy as np
import oracles
import pytest
from scheduler_systems import Ladder
from scipy.stats import chi2

from wavegym.errors import InputError
from wavegym.schedulers import Fixed, Policy, RandomChoice, RoundRobin
from wavegym.systems.kershaw_evans import KershawEvansPosition

SYSTEM, BOX = KershawEvansPosition(), KershawEvansPosition(action="box")


def ready(policy, system, count=1, seed=0):
    policy.begin(system, count, np.random.default_rng(seed))
    assert isinstance(policy, Policy)
    return policy


def public_of(system, count):
    return system.begin(oracles.worlds(system, count)).public


def test_random_is_uniform_over_what_is_allowed():
    count = 56_000
    mask = np.zeros((count, 56), bool)
    mask[:, ::2] = True
    policy = ready(RandomChoice(), SYSTEM)
    public = public_of(SYSTEM, 1)._replace(step=np.zeros(count, int))
    for allowed, options in ((None, 56), (mask, 28)):
        tally = np.bincount(policy.act(public, None, allowed), minlength=56)
        assert (tally > 0).sum() == options
        tally = tally[tally > 0]
        statistic = (np.square(tally - count / options) / (count / options)).sum()
        assert statistic < chi2.ppf(1 - 1e-6, options - 1)


def test_random_follows_its_generator():
    public = public_of(SYSTEM, 100)
    first, again, other = (ready(RandomChoice(), SYSTEM, seed=s).act(public, None, None) for s in (1, 1, 2))
    assert (first == again).all()
    assert (first != other).any()


def test_random_in_a_box_takes_the_librarys_points():
    actions = ready(RandomChoice(), BOX).act(public_of(BOX, 50), None, None)
    assert actions.shape == (50, 2)
    assert all((BOX.candidates() == action).all(axis=1).any() for action in actions)


def test_fixed_never_changes():
    assert (ready(Fixed(7), SYSTEM).act(public_of(SYSTEM, 3), None, None) == 7).all()
    assert (ready(Fixed(7), BOX).act(public_of(BOX, 3), None, None) == BOX.candidates()[7]).all()
    for index, nearest in ((-1, 0), (56, 55)):
        with pytest.raises(InputError, match=f"expected 0 to 55 .nearest: {nearest}"):
            ready(Fixed(index), SYSTEM)


def test_fixed_takes_the_next_allowed_one_in_cyclic_order():
    policy, public = ready(Fixed(7), SYSTEM), public_of(SYSTEM, 4)
    mask = np.ones((4, 56), bool)
    mask[1, 7:9] = False
    mask[2, 7:] = False
    mask[3] = np.arange(56) == 3
    assert policy.act(public, None, mask).tolist() == [7, 9, 0, 3]


def test_round_robin_takes_turns_and_skips():
    policy = ready(RoundRobin(), SYSTEM)
    public = public_of(SYSTEM, 3)._replace(step=np.array([0, 5, 57]))
    assert (policy.act(public, None, None) == [0, 5, 1]).all()
    mask = np.ones((3, 56), bool)
    mask[0, :4] = False
    mask[1, 5:] = False
    assert (policy.act(public, None, mask) == [4, 0, 1]).all()
    ladder = Ladder()
    policy = ready(RoundRobin(), ladder)
    public = public_of(ladder, 40)
    actions = policy.act(public, None, ladder.mask(public))
    assert ladder.mask(public)[np.arange(40), actions].all()
