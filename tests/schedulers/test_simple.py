"""Random, fixed and round robin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import oracles
import pytest
from scheduler_systems import Ladder
from scipy.stats import chi2

from wavegym.core import shortcuts
from wavegym.core.errors import InputError
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.schedulers import Fixed, RandomChoice, RoundRobin
from wavegym.systems.kershaw_evans.system import KershawEvansPosition

SYSTEM, BOX = KershawEvansPosition(), KershawEvansPosition(action="box")


def ready(policy, system, count=1, seed=0):
    policy.begin(system, count, np.random.default_rng(seed))
    assert isinstance(policy, Policy)
    return policy


def beliefs_of(system, count):
    return system.initial(oracles.worlds(system, count)).belief


def test_random_is_uniform_over_what_is_allowed():
    count = 56_000
    mask = np.zeros((count, 56), bool)
    mask[:, ::2] = True
    policy = ready(RandomChoice(), SYSTEM)
    belief = beliefs_of(SYSTEM, 1)._replace(step=np.zeros(count, int))
    for allowed, options in ((None, 56), (mask, 28)):
        tally = np.bincount(policy.act(belief, None, allowed), minlength=56)
        assert (tally > 0).sum() == options
        tally = tally[tally > 0]
        statistic = (np.square(tally - count / options) / (count / options)).sum()
        assert statistic < chi2.ppf(1 - 1e-6, options - 1)


def test_random_follows_its_generator():
    belief = beliefs_of(SYSTEM, 100)
    first, again, other = (ready(RandomChoice(), SYSTEM, seed=s).act(belief, None, None) for s in (1, 1, 2))
    assert (first == again).all()
    assert (first != other).any()


def test_random_in_a_box_is_uniform_over_the_whole_of_it():
    count, cells = 64_000, 8
    actions = ready(RandomChoice(), BOX).act(beliefs_of(SYSTEM, 1)._replace(step=np.zeros(count, int)), None, None)
    assert actions.shape == (count, 2)
    assert (np.abs(actions) <= 1).all()
    tally = np.histogram2d(*actions.T, bins=cells, range=[[-1, 1], [-1, 1]])[0]
    expected = count / cells**2
    assert (np.square(tally - expected) / expected).sum() < chi2.ppf(1 - 1e-6, cells**2 - 1)


def test_fixed_never_changes():
    assert (ready(Fixed(7), SYSTEM).act(beliefs_of(SYSTEM, 3), None, None) == 7).all()
    assert (ready(Fixed(7), BOX).act(beliefs_of(BOX, 3), None, None) == BOX.candidates()[7]).all()
    for index, nearest in ((-1, 0), (56, 55)):
        with pytest.raises(InputError, match=f"expected 0 to 55 .nearest: {nearest}"):
            ready(Fixed(index), SYSTEM)


@dataclass(frozen=True)
class Named(KershawEvansPosition):
    """A constant that is no candidate, and one that is."""


@shortcuts.named_constants.register(Named)
def named_constants(system: Named):
    if system.action == "box":
        return {"published": np.array([0.25, -0.5]), "short": shortcuts.constants(system)[0]}
    return {"published": np.array(9), "short": np.array(0)}


def test_a_constant_may_have_a_name():
    assert shortcuts.named_constants(System()) == {}
    system = Named()
    assert (ready(Fixed("published"), system).act(beliefs_of(system, 3), None, None) == 9).all()
    mask = np.ones((3, 56), bool)
    mask[1, 9] = False
    assert ready(Fixed("published"), system).act(beliefs_of(system, 3), None, mask).tolist() == [9, 10, 9]
    system = Named(action="box")
    actions = ready(Fixed("published"), system).act(beliefs_of(system, 3), None, None)
    assert actions.tolist() == [[0.25, -0.5]] * 3


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(InputError, match=r"^fixed:publishd is no constant .* 'short'; did you mean 'published'.$"):
        ready(Fixed("publishd"), Named())
    with pytest.raises(InputError, match=r"^fixed:56 .* 0 to 55, 'published', 'short' .nearest: 55.$"):
        ready(Fixed(56), Named())
    with pytest.raises(InputError, match=r"^fixed:published is no constant action, expected 0 to 55$"):
        ready(Fixed("published"), SYSTEM)


def test_fixed_takes_the_next_allowed_one_in_cyclic_order():
    policy, belief = ready(Fixed(7), SYSTEM), beliefs_of(SYSTEM, 4)
    mask = np.ones((4, 56), bool)
    mask[1, 7:9] = False
    mask[2, 7:] = False
    mask[3] = np.arange(56) == 3
    assert policy.act(belief, None, mask).tolist() == [7, 9, 0, 3]


def test_round_robin_takes_turns_and_skips():
    policy = ready(RoundRobin(), SYSTEM)
    belief = beliefs_of(SYSTEM, 3)._replace(step=np.array([0, 5, 57]))
    assert (policy.act(belief, None, None) == [0, 5, 1]).all()
    mask = np.ones((3, 56), bool)
    mask[0, :4] = False
    mask[1, 5:] = False
    assert (policy.act(belief, None, mask) == [4, 0, 1]).all()
    ladder = Ladder()
    policy = ready(RoundRobin(), ladder)
    belief = beliefs_of(ladder, 40)
    actions = policy.act(belief, None, ladder.mask(belief))
    assert ladder.mask(belief)[np.arange(40), actions].all()
