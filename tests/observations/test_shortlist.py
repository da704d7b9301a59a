"""Short lists of actions: what they hold, how an agent sends from them, and whose policies play elsewhere."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from wavegym.core.errors import InputError
from wavegym.evaluation import compare
from wavegym.evaluation.play import make_task
from wavegym.observations.observer import Observer
from wavegym.observations.shortlist import NEAR, Shortlist, _first_then_cheapest, shortlist
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.rollout import allowed

LISTED = ["KershawEvans-v0", "EnergyBudget-v0", "RfEo-v0", "AgileClutter-v0"]
COUNT = 6


def made(name: str, num_envs: int = 3, **settings: Any) -> Any:
    """A vector environment after its reset, and its belief after some random steps."""
    envs: Any = gym.make_vec(f"wavegym/{name}", num_envs=num_envs, **settings).unwrapped
    envs.reset(seed=3)
    envs.action_space.seed(0)
    return envs


def later(envs: Any, steps: int = 2) -> Any:
    """The belief after some steps with the best action."""
    for _ in range(steps):
        envs.step(np.zeros(envs.num_envs, np.int64))
    return envs.belief


def costs_of(system: Any, belief: Any, actions: np.ndarray) -> np.ndarray:
    """Expected costs (env, rank) of actions (env, rank, ...), each predicted on its own."""
    each = [system.cost(system.predict(belief, actions[:, rank])) for rank in range(actions.shape[1])]
    return np.stack(each, axis=1)


@pytest.mark.parametrize("name", LISTED)
def test_the_first_rank_is_the_choice_of_the_one_step_scheduler(name: str) -> None:
    envs = made(name, candidates=COUNT)
    belief = later(envs)
    myopic = make_policy("myopic", envs.system, None)
    myopic.begin(envs.system, 3, np.random.default_rng(0))
    wanted = myopic.act(belief, None, allowed(envs.system, belief))
    np.testing.assert_array_equal(Shortlist(envs.system, COUNT)(belief).actions[:, 0], wanted)


@pytest.mark.parametrize("name", LISTED)
def test_costs_rise_with_the_rank_behind_the_first(name: str) -> None:
    envs = made(name, candidates=COUNT)
    belief = later(envs)
    costs = costs_of(envs.system, belief, Shortlist(envs.system, COUNT)(belief).actions)
    assert (np.diff(costs[:, 1:], axis=1) > 0.0).all()


def test_a_list_of_a_library_holds_the_cheapest_of_all_actions() -> None:
    envs = made("KershawEvans-v0", candidates=COUNT)
    belief = later(envs)
    everything = np.broadcast_to(np.arange(88), (3, 88))
    listed = Shortlist(envs.system, COUNT)(belief)
    np.testing.assert_array_equal(listed.actions, costs_of(envs.system, belief, everything).argsort(axis=1)[:, :COUNT])
    assert listed.allowed.all()


def test_a_listed_action_of_several_sensors_differs_from_the_first_at_one_sensor() -> None:
    envs = made("AgileClutter-v0", candidates=200)
    listed = Shortlist(envs.system, 200)(later(envs))
    differs = (listed.actions[:, 1:] != listed.actions[:, :1]).any(axis=2)
    at = (listed.actions[:, 1:] != listed.actions[:, :1]).sum(axis=2)
    assert listed.actions.shape == (3, 1 + 2 * 72, 2)  # the first, which is among the changes of each sensor too
    assert (at <= 1).all()
    assert differs.sum(axis=1).tolist() == [2 * 71] * 3


def test_a_listed_point_of_a_box_differs_in_one_platforms_settings_or_by_a_step_in_one_parameter() -> None:
    envs = made("RfEo-v0", candidates=57)
    actions = Shortlist(envs.system, 57)(later(envs)).actions
    moved = np.abs(actions - actions[:, :1]) > 0.0
    by_platform = moved.reshape(3, 57, 2, 3).any(axis=3)
    assert (by_platform.sum(axis=2) <= 1).all()
    steps = np.abs(actions - actions[:, :1]).max(axis=2)
    one = moved.sum(axis=2) == 1
    assert all(np.isclose(steps[one], near).any() for near in NEAR)
    assert np.abs(actions).max() <= 1.0


@pytest.mark.parametrize("name", LISTED)
def test_a_rank_sends_its_action(name: str) -> None:
    listed, plain = made(name, candidates=COUNT), made(name)
    for rank in (0, 1):
        *outcome, info = listed.step(np.full(3, rank))
        *wanted, _ = plain.step(info["sent"])
        np.testing.assert_array_equal(outcome[1], wanted[1])
        own = plain.single_observation_space.shape[0]
        np.testing.assert_array_equal(outcome[0][:, :own], wanted[0])


def test_the_observation_tells_the_cost_and_the_action_of_each_rank() -> None:
    envs = made("RfEo-v0", candidates=COUNT)
    observation, _ = envs.reset(seed=5)
    own = len(envs.system.observation_fields)
    figures = observation[:, own:].reshape(3, COUNT, 7)
    listed = Shortlist(envs.system, COUNT)(envs.belief)
    costs = costs_of(envs.system, envs.belief, listed.actions)
    np.testing.assert_allclose(figures[..., 0], np.log(costs / costs.mean(axis=1, keepdims=True)) / 0.3, atol=1e-5)
    np.testing.assert_allclose(figures[..., 1:], listed.actions, atol=1e-6)


def test_each_environment_of_a_batch_has_the_list_that_it_has_alone() -> None:
    for name in LISTED:
        batch = made(name, candidates=COUNT)
        for i in range(3):
            alone = gym.make(f"wavegym/{name}", candidates=COUNT)
            observation, _ = alone.reset(seed=3 + i)
            np.testing.assert_array_equal(observation, batch.episodes.observe()[0][i])


def test_masked_actions_are_not_listed_and_their_ranks_are_not_allowed() -> None:
    envs = made("EnergyBudget-v0", candidates=10)
    for _ in range(envs.system.horizon - 1):
        if (mask := envs.system.mask(envs.belief)).sum(axis=1).min() < 10:
            break
        envs.step(np.zeros(3, np.int64))
    assert mask.sum(axis=1).min() < 10, "the account never ran low"
    listed = Shortlist(envs.system, 10)(envs.belief)
    np.testing.assert_array_equal(listed.allowed.sum(axis=1), np.minimum(mask.sum(axis=1), 10))
    assert mask[np.arange(3)[:, None], listed.actions].all()
    np.testing.assert_array_equal(envs.action_masks(), listed.allowed)


def test_a_list_that_would_hold_a_whole_library_is_none_and_shows_its_forecasts() -> None:
    system = make_task("CameraSlew-v0", {}).system
    assert shortlist(system, len(system.candidates())) is None
    observers = Observer(system, candidates=32), Observer(system, forecasts=True)
    assert observers[0].observation_fields == observers[1].observation_fields
    assert gym.make("wavegym/CameraSlew-v0", candidates=32).action_space == gym.spaces.Discrete(4)


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("RfEo-v0", {"candidates": 0}, "candidates is 0, expected an integer >= 1 (nearest: 1)"),
        ("RfEo-v0", {"candidates": 2.5}, "candidates is 2.5, expected an integer >= 1 (nearest: 2)"),
        ("RfEo-v0", {"candidates": "myopic"}, "candidates is 'myopic', expected an integer >= 1 (nearest: 1)"),
        ("MultifunctionRadar-v1", {"candidates": 8}, "candidates is 8 in MultifunctionRadar, expected forecasts=True"),
        ("KershawEvans-v0", {"candidates": 8, "observation": "measurements"}, "candidates is 8 with observation="),
    ],
)
def test_other_lists_are_refused(name: str, settings: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as refused:
        gym.make(f"wavegym/{name}", **settings)
    assert str(refused.value).startswith(message)


def test_policies_that_name_actions_do_not_follow_an_environment_of_ranks() -> None:
    with pytest.raises(InputError, match="candidates is 6, expected an environment without it: policies name actions"):
        made("RfEo-v0", candidates=COUNT).policy("myopic")


def test_a_rank_beyond_the_list_is_refused() -> None:
    envs = made("RfEo-v0", candidates=COUNT)
    with pytest.raises(InputError, match=r"action is 6, expected an index in \[0, 5\] \(nearest: 5\)"):
        envs.step(np.array([0, 6, 0]))
    with pytest.raises(InputError, match=r"ranks are 0 to 6, expected indices in \[0, 5\]"):
        Shortlist(envs.system, COUNT).taken(envs.belief, np.array([0, 6, 0]))


class Ranked:
    """A model that always sends one rank."""

    def __init__(self, envs: Any, rank: int) -> None:
        self.observation_space, self.action_space = envs.single_observation_space, envs.single_action_space
        self.rank = rank

    def predict(self, observation: np.ndarray) -> np.ndarray:
        """The rank, for each environment."""
        return np.full(len(observation), self.rank)


@pytest.mark.parametrize("name", ["RfEo-v0", "EnergyBudget-v0"])
def test_a_function_sees_and_sends_what_the_comparison_says(name: str) -> None:
    """As a model of that environment, which tells its spaces, does unasked."""
    envs, widths = made(name, candidates=COUNT), set()

    def last(observation: np.ndarray) -> np.ndarray:
        widths.add(observation.shape[1])
        return np.full(len(observation), COUNT - 1)

    policies = {"model": Ranked(envs, COUNT - 1), "function": last}
    found = compare(name, policies, candidates=COUNT, worlds=2, jobs=1, progress=False, horizon=5)
    assert widths == {envs.single_observation_space.shape[0]}
    np.testing.assert_array_equal(found.cost("function"), found.cost("model"))


def test_a_list_repeats_no_cost_and_keeps_the_first() -> None:
    costs = np.array([[2.0, 1.0, 2.0, 3.0, 1.0, 3.0, 2.0]])
    assert _first_then_cheapest(costs).tolist() == [[0, 1, 3, 4, 2, 6, 5]]


@pytest.mark.parametrize("name", ["RfEo-v0", "EnergyBudget-v0"])
def test_a_model_that_sends_ranks_plays_against_schedulers(name: str) -> None:
    envs = made(name, candidates=COUNT)
    models = {"first": Ranked(envs, 0), "last": Ranked(envs, COUNT - 1), "myopic": None}
    found = compare(f"wavegym/{name}", models, worlds=4, jobs=1, progress=False, horizon=10)
    np.testing.assert_array_equal(found.cost("first"), found.cost("myopic"))
    assert (found.cost("last") != found.cost("myopic")).all()
