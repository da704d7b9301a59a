"""The most information with a threshold, against all actions of small grids; SLSQP against optima in closed form."""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
import oracles
import pytest
from rf_eo_scenes import beliefs, scene
from scheduler_systems import Level

from wavegym.core import shortcuts
from wavegym.core.action_sets import Parameter, ParameterBox
from wavegym.core.errors import InputError
from wavegym.schedulers import Continuous, InfeasibleThreshold, Myopic, MyopicClosedForm, MyopicInformation, rollout
from wavegym.systems.kershaw_evans.system import KershawEvansPosition
from wavegym.systems.rf_eo.system import RfEo


def act(policy, system, belief, seed=0):
    policy.begin(system, len(belief.step), np.random.default_rng(seed))
    return policy.act(belief, None, None)


def listed(system, belief):
    """Least share and sum of information of every action, (env, action)."""
    information = system.information(belief, system.candidates()[None])
    return information.min(axis=-1), information.sum(axis=-1)


def held_to_all_actions(system, threshold):
    """Beliefs along a run: whether t can be reached, whether it was, and how often the choice is the best of all."""
    belief = beliefs(system)
    rows = np.arange(len(belief.step))
    share, total = listed(system, belief)
    chosen, feasible = shortcuts.most_information(system, belief, threshold)
    possible = share.max(axis=1) >= threshold
    assert (feasible == (share[rows, chosen] >= threshold)).all()
    enough = np.minimum(share.max(axis=1), threshold)[:, None]
    best = np.where(share >= enough, total, -np.inf).max(axis=1)
    met = share[rows, chosen] >= enough[:, 0]
    assert (total[rows, chosen][met] <= best[met]).all()
    return possible, feasible, met & (total[rows, chosen] >= best * (1 - 1e-9))


@pytest.mark.parametrize("far", [False, True])
@pytest.mark.parametrize("targets", [1, 2, 3])
def test_one_platform_has_the_best_of_all_its_settings_whatever_the_threshold(far, targets):
    system = scene(far, 1, targets, points=(8, 1, 8), action="joint")
    share, _ = listed(system, beliefs(system))
    for threshold in (0.0, *np.quantile(share.max(axis=1), [0.3, 0.6]), 2 * share.max()):
        possible, feasible, best = held_to_all_actions(system, threshold)
        assert (possible == feasible).all()
        assert best.all()


@pytest.mark.parametrize("far", [False, True])
@pytest.mark.parametrize(("platforms", "targets"), [(2, 1), (2, 2), (3, 1), (3, 3)])
@pytest.mark.parametrize("margin", [0.0, 2.0])
def test_a_threshold_that_does_not_bind_costs_nothing(far, platforms, targets, margin):
    """Information adds up over platforms, so each one's own best is best."""
    points = (6, 2, 5) if platforms == 2 else (3, 1, 3)
    system = scene(far, platforms, targets, points=points, action="joint", margin=margin)
    possible, feasible, best = held_to_all_actions(system, 0.0)
    assert possible.all()
    assert feasible.all()
    assert best.all()


@pytest.mark.parametrize(("far", "least"), [(False, 0.5), (True, 0.95)])
def test_a_threshold_that_binds_is_met_by_several_platforms_or_said_not_to_be(far, least):
    """Platform after platform is a local search: near three targets it finds the best of all in most cases only."""
    system = scene(far, 3, 3, points=(3, 1, 3), action="joint")
    share, total = listed(system, beliefs(system))
    threshold = float(np.quantile(share.max(axis=1), 0.4))
    possible, feasible, best = held_to_all_actions(system, threshold)
    binding = (total.argmax(axis=1) != np.where(share >= threshold, total, -np.inf).argmax(axis=1)) & possible
    assert binding.mean() > 0.2
    assert not (feasible & ~possible).any()
    assert best.mean() >= least


def apart(**kwargs):
    """One platform between two targets at right angles: a narrow image shows one of them at most."""
    starts = ((-2e3, 0.0, 500.0, 0.0), (300.0, 0.0, 2e3, 0.0))
    given = {"platforms": ((0.0, 0.0),), "points": (6, 1, 24), "starts": starts, "first_estimate": "drawn"}
    return RfEo(**{**given, "horizon": 12, "prior_variance": (1e4, 25.0, 1e4, 25.0), "action": "joint", **kwargs})


def test_a_binding_threshold_widens_the_image_and_one_beyond_reach_is_said_once():
    system = apart(threshold=0.0)
    belief = beliefs(system, steps=3)
    share, total = listed(system, belief)
    reach = share.max(axis=1)
    free, bound = (
        act(MyopicInformation(), dataclasses.replace(system, threshold=t), belief) for t in (0.0, reach.min())
    )
    assert (free != bound).any()
    rows = np.arange(len(free))
    assert (share[rows, free] < reach.min()).any()
    assert (share[rows, bound] >= reach.min()).all()
    assert (total[rows, bound] <= total[rows, free]).all()
    assert (system.action_set.settings(bound)[..., 2] >= system.action_set.settings(free)[..., 2]).all()
    threshold = float(np.median(reach))
    policy, above = MyopicInformation(), dataclasses.replace(system, threshold=threshold)
    short = reach < threshold
    words = (
        rf"threshold is {threshold:g}, not reached in {short.sum()} of {len(reach)} environments.*{reach.min():.3g}\)$"
    )
    with pytest.warns(InfeasibleThreshold, match=words) as caught:
        chosen = act(policy, above, belief)
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = policy.act(belief, None, None)
    assert "\n" not in str(caught[0].message)
    assert (policy.feasible == ~short).all()
    assert (chosen == again).all()
    np.testing.assert_allclose(share[rows, chosen][short], reach[short], rtol=1e-12)
    with pytest.warns(InfeasibleThreshold):
        act(policy, above, belief)  # the next batch of episodes warns again


def test_the_loop_knows_what_the_scheduler_could_not_reach():
    system = apart(threshold=1e9, action="box")
    worlds = oracles.worlds(system, 2)
    state, policy = system.initial(worlds), MyopicInformation()
    with pytest.warns(InfeasibleThreshold):
        action = act(policy, system, state.belief)
    assert not policy.feasible.any()
    assert system.state_info(system.transition(state, action, worlds))["below_threshold"].all()


@pytest.mark.parametrize("far", [False, True])
def test_the_default_threshold_can_be_had(far):
    system = scene(far, horizon=30)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        played = rollout(system, MyopicInformation(), oracles.worlds(system, 3))
    assert np.isfinite(played.cost).all()


@pytest.mark.parametrize(
    "system", [scene(horizon=6), scene(True, horizon=6), scene(penalty="deadzone"), scene(penalty="log-barrier")]
)
def test_a_polished_choice_is_better_than_the_grids_and_never_worse(system):
    belief = beliefs(system, 2, 3)
    grid, polished = (system.cost(system.predict(belief, act(p, system, belief))) for p in (Myopic(), Continuous()))
    assert (polished <= grid).all()
    assert polished.mean() < grid.mean()


@pytest.mark.parametrize("starts", [0, 4])
def test_slsqp_reaches_the_optimum_in_closed_form(starts):
    system = KershawEvansPosition(action="box", eclipsing=False)
    belief = beliefs(system, 3, 4)
    policies = Myopic(), MyopicClosedForm(), Continuous(starts=starts)
    grid, optimum, found = (system.cost(system.predict(belief, act(p, system, belief))) for p in policies)
    assert (grid / optimum).max() > 1.005
    np.testing.assert_allclose(found, optimum, rtol=1e-6)


def test_a_search_from_drawn_points_is_never_worse_than_they_are_and_more_starts_help():
    system = scene(True)
    belief = beliefs(system, 2, 3)
    drawn = np.random.default_rng(7).uniform(-1, 1, (5, 6))
    start = system.cost(system.predict(belief, drawn[None]))
    few, many = (act(Continuous(starts=n), system, belief, 7) for n in (1, 5))
    few, many = (system.cost(system.predict(belief, a)) for a in (few, many))
    assert (few <= start[:, 0]).all()
    assert (many <= start.min(axis=1)).all()
    assert (many <= few).all()  # the first draw is the same
    assert many.mean() < few.mean()


@pytest.mark.parametrize("starts", [0, 3])
def test_a_decision_depends_on_the_belief_alone(starts):
    system = scene(True)
    belief = beliefs(system, 2, 2)
    together = act(Continuous(starts=starts), system, belief)
    for e in (0, 3):
        assert (act(Continuous(starts=starts), system, oracles.rows(belief, slice(e, e + 1)))[0] == together[e]).all()
    assert (np.abs(together) <= 1).all()


def test_continuous_information_keeps_the_threshold_and_gains_on_the_grid():
    system = scene(threshold=0.5)
    belief = beliefs(system, 2, 4)
    grid, fine = (
        system.information(belief, act(p, system, belief)) for p in (MyopicInformation(), Continuous("information"))
    )
    assert (fine.sum(axis=1) >= grid.sum(axis=1)).all()
    assert fine.sum() > 1.001 * grid.sum()
    assert (fine.min(axis=1) >= 0.5).all()


def test_a_binding_threshold_holds_in_the_box_too():
    system = apart(action="box")
    belief = beliefs(system, 2, 3)
    reach = system.information(belief, shortcuts.most_information(system, belief, np.inf)[0]).min(axis=1)
    threshold = float(0.9 * reach.min())
    policy, held = Continuous("information"), dataclasses.replace(system, threshold=threshold)
    share = system.information(belief, act(policy, held, belief))
    assert policy.feasible.all()
    assert (share.min(axis=1) >= threshold).all()
    assert (
        share.sum(axis=1) >= system.information(belief, shortcuts.most_information(held, belief)[0]).sum(axis=1)
    ).all()
    free = act(Continuous("information"), dataclasses.replace(system, threshold=0.0), belief)
    assert (system.information(belief, free).min(axis=1) < threshold).any()
    with pytest.warns(InfeasibleThreshold, match="threshold is 1e\\+09, not reached in 8 of 8"):
        beyond = act(policy, dataclasses.replace(system, threshold=1e9), belief)
    assert not policy.feasible.any()
    assert (system.information(belief, beyond).min(axis=1) >= reach * (1 - 1e-12)).all()


@dataclasses.dataclass
class Tilt:
    """One parameter a: the first target's information is 5 + 4a, the second's 2 - a."""

    threshold: float
    actions = ParameterBox((Parameter("a", "", 1.0, 2.0),))

    def information(self, belief, actions):
        return np.concatenate([5 + 4 * actions, 2 - actions], axis=-1)


@shortcuts.most_information.register(Tilt)
def most_information(system, belief):
    return np.full((len(belief.step), 1), -1.0), np.ones(len(belief.step), bool)


@pytest.mark.parametrize("starts", [0, 1])
@pytest.mark.parametrize(("threshold", "best"), [(0.0, 1.0), (0.5, 1.0), (1.5, 0.5), (2.5, -0.5), (3.5, -0.6)])
def test_a_constraint_is_met_where_it_is_tight(starts, threshold, best):
    """Beyond a = 2 - t the second target has too little. It never has 3.5; the greatest least share is at a = -3/5."""
    belief = Level(np.zeros(2, int), np.zeros(2))
    policy = Continuous("information", starts)
    if threshold == 3.5:
        with pytest.warns(InfeasibleThreshold, match="nearest that all reach: 2.6"):
            actions = act(policy, Tilt(threshold), belief)
    else:
        actions = act(policy, Tilt(threshold), belief)
        assert (2 - actions >= threshold).all()
    np.testing.assert_allclose(actions, best, atol=1e-5)
    assert policy.feasible.all() == (threshold < 3.5)


def test_no_threshold_is_no_constraint():
    system = scene(threshold=0.0)
    belief = beliefs(system, 2, 1)
    policy = Continuous("information", 2)
    act(policy, system, belief)
    assert policy.feasible.all()


def test_a_threshold_that_is_no_number_is_refused():
    system = scene(False)
    belief = beliefs(system, 1, 1)
    for threshold in (-1.0, np.nan):
        with pytest.raises(InputError, match=r"threshold is .* expected a number >= 0"):
            shortcuts.most_information(system, belief, threshold)
