"""The searched rule finds a planted linear rule, respects masks, and names the command where its features changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest
from delay_systems import DelaySystem, delay_worlds

from wavegym.core import shortcuts, trees
from wavegym.core.action_sets import Library
from wavegym.core.errors import InputError
from wavegym.core.system import ObservationField, State, System
from wavegym.observations.forecasts import Forecasts
from wavegym.schedulers import Myopic, RandomChoice, rollout
from wavegym.schedulers.heuristics.cma_search import Budget
from wavegym.schedulers.heuristics.index_policies import HoldUntilDetected
from wavegym.schedulers.heuristics.price_policies import LagrangianPrice
from wavegym.schedulers.heuristics.rule_features import RuleFeatures
from wavegym.schedulers.heuristics.searched_rule import SearchedRule, feature_scales, search_rule
from wavegym.schedulers.tuning import log_cost
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.systems.kershaw_evans.system import KershawEvansPosition
from wavegym.systems.rf_eo.system import RfEo

WEIGHT = 1.7  # of ln(1 + delay) against ln(gain) in the planted rule


class PlantedWorld(NamedTuple):
    gain: Any  # (env, H, candidate)
    wait: Any  # (env, H, candidate) int
    decoy: Any  # (env, H, candidate) expected cost, which says nothing


class PlantedBelief(NamedTuple):
    step: Any
    gain: Any
    wait: Any
    decoy: Any
    last: Any  # (env,) cost


@dataclass(frozen=True)
class Planted(System):
    """A step costs exp(-(ln gain - WEIGHT ln(1 + delay))) of the candidate chosen: the best rule is linear."""

    horizon: int = 8

    @property
    def actions(self):
        return Library(("a", "b", "c", "d", "e"))

    @property
    def observation_fields(self):
        return (ObservationField("step", "1", 0.0, 1.0, "step"),)

    def draw_world(self, rng):
        shape = self.horizon, 5
        return PlantedWorld(
            np.exp(rng.normal(0.0, 1.0, shape)), rng.integers(0, 9, shape), np.exp(rng.normal(size=shape))
        )

    def initial(self, world):
        count = len(world.gain)
        belief = PlantedBelief(np.zeros(count, np.int64), world.gain, world.wait, world.decoy, np.ones(count))
        return State(np.zeros(count), belief)

    def _now(self, belief, table):
        return table[np.arange(len(belief.step)), np.minimum(belief.step, self.horizon - 1)]

    def worth(self, belief):
        return np.log(self._now(belief, belief.gain)) - WEIGHT * np.log1p(self._now(belief, belief.wait))

    def transition(self, state, action, world):
        worth = self.worth(state.belief)[np.arange(len(action)), action]
        return State(state.truth, state.belief._replace(step=state.belief.step + 1, last=np.exp(-worth)))

    def predict(self, belief, actions, outcome=None):
        count = actions.shape[1]
        rows = trees.repeated(belief, count)
        rows = rows._replace(last=self._now(belief, belief.decoy).ravel(), step=rows.step + 1)
        return trees.tree_map(lambda leaf: leaf.reshape(-1, count, *leaf.shape[1:]), rows)

    def cost(self, belief):
        return belief.last

    def observe(self, belief):
        return belief.step[:, None].astype(np.float64)


@shortcuts.gain.register(Planted)
def gain(system, belief, wait, ahead):
    return system._now(belief, belief.gain) * np.ones(np.shape(wait))


@shortcuts.delay.register(Planted)
def delay(system, belief):
    return system._now(belief, belief.wait)


class Best:
    """The planted rule."""

    def begin(self, system, num_envs, rng):
        self.system = system

    def act(self, belief, observation, mask):
        return self.system.worth(belief).argmax(axis=1)


def planted_cost(rule, count=200, seed=7):
    """Per cent above the planted rule's cost, in worlds that the search has not met."""
    system = Planted()
    worlds = delay_worlds(system, count, seed)
    return 100.0 * np.expm1(log_cost(system, rule, worlds) - log_cost(system, Best(), worlds))


@pytest.mark.slow
def test_the_search_finds_the_planted_rule():
    """A rule without the weights of the delay costs more, so the cost shows whether it is found."""
    system = Planted()
    found = search_rule(system, delay_worlds(system, 60), Budget(500), seed=1)
    rule = SearchedRule(**found.constants)
    assert found.evaluations <= 500
    assert planted_cost(rule) < 2.0
    assert planted_cost(Myopic()) > 100.0
    played, best = (rollout(system, policy, delay_worlds(system, 50, 3)).actions for policy in (rule, Best()))
    assert (played == best).mean() > 0.95
    features = found.constants["features"]
    weights = [
        0.0 if "delay" in name or name == "ready" else weight
        for name, weight in zip(features, found.constants["weights"], strict=True)
    ]
    assert planted_cost(SearchedRule(features, weights, found.constants["scales"])) > 10.0


def test_a_budget_in_evaluations_is_reproducible_and_another_seed_differs():
    system = Planted()
    worlds = delay_worlds(system, 10)
    one, two, other = (search_rule(system, worlds, Budget(60), seed) for seed in (0, 0, 1))
    assert one.constants == two.constants
    assert (one.cost, one.evaluations) == (two.cost, two.evaluations) == (one.cost, 60)
    assert other.constants["weights"] != one.constants["weights"]


@pytest.mark.slow
def test_the_result_is_at_least_as_good_as_every_start_on_the_worlds_of_the_search():
    system = DelaySystem()
    worlds = delay_worlds(system, 10)
    found = search_rule(system, worlds, Budget(80))
    assert found.cost <= log_cost(system, Myopic(), worlds) + 1e-12


def belief_of(system, steps=4, count=30):
    worlds = delay_worlds(system, count)
    state, policy = system.initial(worlds), RandomChoice()
    policy.begin(system, count, np.random.default_rng(0))
    for _ in range(steps):
        state = system.transition(state, policy.act(state.belief, None, system.mask(state.belief)), worlds)
    return state.belief


def rule_of(system, **weights):
    """A rule with scales of 1."""
    names = RuleFeatures(system).names
    unknown = set(weights) - set(names)
    assert not unknown
    rule = SearchedRule(names, [weights.get(name, 0.0) for name in names], np.ones(len(names)))
    rule.begin(system, 1, np.random.default_rng(0))
    return rule


@pytest.mark.parametrize("power", [0, 1])
def test_the_rule_contains_the_price_and_the_hold(power):
    """Other heuristics are points of the family, so the search may start from them."""
    system = DelaySystem(budget=9.0)
    belief = belief_of(system)
    mask = system.mask(belief)
    price = LagrangianPrice(0.3, 8, power)
    price.begin(system, 1, np.random.default_rng(0))
    spent = {0: "spending", 1: "spending*scarcity"}[power]
    np.testing.assert_array_equal(
        rule_of(system, **{"gain_8": 1.0, spent: -0.3}).act(belief, None, mask), price.act(belief, None, mask)
    )
    hold = HoldUntilDetected(6)
    hold.begin(system, 1, np.random.default_rng(0))
    np.testing.assert_array_equal(rule_of(system, hold_6=1.0).act(belief, None, mask), hold.act(belief, None, mask))


def test_the_rule_contains_the_one_step_scheduler():
    system = DelaySystem()
    belief = belief_of(system)
    ahead = system.cost(system.predict(belief, np.broadcast_to(np.arange(5), (30, 5))))
    masked = np.where(system.mask(belief), ahead, np.inf)
    chosen = rule_of(system, ln_cost_ahead=-1.0).act(belief, None, system.mask(belief))
    np.testing.assert_allclose(masked[np.arange(30), chosen], masked.min(axis=1))


def test_features_are_the_forecasts_that_learners_see():
    system = DelaySystem()
    belief = belief_of(system)
    forecasts = Forecasts(system)
    seen = forecasts(belief).reshape(30, 5, -1)
    shared = [f for f in forecasts.candidate_fields if f.name in RuleFeatures(system).names]
    assert len(shared) == 11  # the cost, eight gains, delay, spending
    values = RuleFeatures(system)(belief, tuple(f.name for f in shared))
    at = [forecasts.candidate_fields.index(f) for f in shared]
    scaled = (values - [f.centre for f in shared]) / [f.scale for f in shared]
    np.testing.assert_allclose(np.clip(scaled, -10, 10), seen[..., at], rtol=1e-4, atol=1e-5)


def test_the_mask_is_respected():
    system = DelaySystem(budget=1.1)
    belief = belief_of(system)
    mask = system.mask(belief)
    rule = rule_of(system, spending=1.0)
    rows = np.arange(30)
    assert mask[rows, rule.act(belief, None, mask)].all()
    assert not mask[rows, rule.act(belief, None, None)].all()  # the defect that this test would notice


def test_a_batch_equals_its_elements():
    system = DelaySystem()
    names = RuleFeatures(system).names
    rng = np.random.default_rng(3)
    rule = SearchedRule(names, rng.normal(size=len(names)), np.ones(len(names)))
    rule.begin(system, 1, np.random.default_rng(0))
    belief = belief_of(system)
    together = RuleFeatures(system)(belief, names)
    for row in range(30):
        alone = RuleFeatures(system)(trees.take(belief, np.array([row])), names)
        np.testing.assert_array_equal(alone[0], together[row])


def test_scales_are_deviations_between_the_candidates_of_a_decision():
    system = Planted()
    worlds = delay_worlds(system, 20)
    names = RuleFeatures(system).names
    scale = dict(zip(names, feature_scales(system, Myopic(), worlds), strict=True))
    logs = np.log1p(worlds.wait.astype(float))
    off = logs - logs.mean(axis=2, keepdims=True)
    assert scale["ln_delay"] == pytest.approx(np.sqrt((off**2).mean()), rel=1e-12)


def test_changed_features_name_the_command():
    system = DelaySystem()
    names = RuleFeatures(system).names
    rule = SearchedRule(("older", *names[1:]), [1.0] * len(names), [1.0] * len(names))
    with pytest.raises(
        InputError, match=r"other features .*ln_cost_ahead, older.* wavegym.evaluation.tune_constants ID"
    ):
        rule.begin(system, 1, np.random.default_rng(0))
    swapped = SearchedRule(names[::-1], [1.0] * len(names), [1.0] * len(names))
    with pytest.raises(InputError, match="it differs in order"):
        swapped.begin(system, 1, np.random.default_rng(0))
    with pytest.raises(InputError, match="3 features, 2 weights and 1 scales, expected as many of each"):
        SearchedRule(["a", "b", "c"], [1.0, 2.0], [1.0])


@pytest.mark.parametrize("make", [AgileClutter, RfEo])
def test_systems_without_one_index_are_refused_in_one_line(make):
    with pytest.raises(InputError, match=r"cannot score the actions of .* expected one index for at most 256") as error:
        RuleFeatures(make())
    assert "\n" not in str(error.value)


def test_a_system_without_gains_has_predictions_of_several_steps():
    system = KershawEvansPosition(horizon=6)
    features = RuleFeatures(system)
    assert "ln_cost_4" in features.names
    worlds = delay_worlds(system, 3)
    found = search_rule(system, worlds, Budget(30))
    assert np.isfinite(found.cost)
