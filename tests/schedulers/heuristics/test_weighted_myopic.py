"""The one-step scheduler with other weights: its choices, the search for its weights, systems it is not for."""

from __future__ import annotations

import numpy as np
import pytest

from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.schedulers import Myopic
from wavegym.schedulers.heuristics.cma_search import Budget
from wavegym.schedulers.heuristics.weighted_myopic import WeightedMyopic, search_weights
from wavegym.schedulers.tuning import log_cost
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition
from wavegym.systems.rf_eo.system import RfEo

ENVS = 4


def beliefs(system, steps=3):
    """Beliefs after some steps of the one-step scheduler."""
    worlds = draw_worlds(system, world_seeds(0, "tune", ENVS))
    state, myopic = system.initial(worlds), begun(Myopic(), system)
    for _ in range(steps):
        state = system.transition(state, myopic.act(state.belief, None, None), worlds)
    return state.belief


def begun(policy, system):
    policy.begin(system, ENVS, np.random.default_rng(0))
    return policy


@pytest.mark.parametrize("weights", [(1.0, 0.0), (2.0, 0.3), (1.0, 40.0)])
def test_the_choice_has_the_least_weighted_trace(weights):
    """Oracle: W written out, every candidate tried; and the same among those that a mask leaves."""
    system = KershawEvans()
    policy, belief = begun(WeightedMyopic(weights), system), beliefs(system)
    covariance = system.predict(belief, system.candidates()[None]).covariance
    traces = np.einsum("ij,ecji->ec", np.diag(weights), covariance)
    chosen, mask = policy.act(belief, None, None), np.ones(traces.shape, bool)
    np.testing.assert_allclose(traces[np.arange(ENVS), chosen], traces.min(axis=1), rtol=1e-12)
    mask[np.arange(ENVS), chosen] = False
    masked, others = policy.act(belief, None, mask), np.where(mask, traces, np.inf)
    np.testing.assert_allclose(others[np.arange(ENVS), masked], others.min(axis=1), rtol=1e-12)


@pytest.mark.parametrize("system", [RfEo(horizon=20), AgileClutter(), KershawEvans()])
def test_with_the_weights_of_the_cost_it_is_the_one_step_scheduler(system):
    belief = beliefs(system)
    chosen = begun(Myopic(), system).act(belief, None, None)
    np.testing.assert_array_equal(begun(WeightedMyopic(system.weights), system).act(belief, None, None), chosen)
    if not isinstance(system, KershawEvans):  # where one pulse is the best for all weights
        others = np.where(np.arange(len(system.weights)) % 2, system.weights, 1e-5)
        assert (begun(WeightedMyopic(others), system).act(belief, None, None) != chosen).any()


def test_a_weight_on_the_velocity_pays_where_the_cost_has_none():
    """What a look tells about the velocity pays at the next step: the weights found cost less on other worlds."""
    system = KershawEvansPosition()
    found = search_weights(system, draw_worlds(system, world_seeds(0, "tune", 20)), Budget(40))
    test = draw_worlds(system, world_seeds(1, "test", 20))
    assert found["weights"][0] == system.weights[0]
    assert found["weights"][1] > 0.0
    assert log_cost(system, WeightedMyopic(**found), test) < log_cost(system, Myopic(), test) - 0.05


def test_weights_that_no_cost_may_have_are_refused():
    for weights in ((-1.0, 1.0), (0.0, 0.0), (np.nan, 1.0)):
        with pytest.raises(ValueError, match="weights"):
            begun(WeightedMyopic(weights), KershawEvans())
