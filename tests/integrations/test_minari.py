"""Datasets: every episode is replayed in a new environment, and returns of all actions also follow from replays."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from small_systems import Burner, Tank

from wavegym.core.errors import InputError
from wavegym.integrations.minari import collect, load, stored_in
from wavegym.integrations.minari.collect import ReturnsOfAll
from wavegym.schedulers import Fixed

SHORT = {"horizon": 6}


def seeds(dataset):
    """The seed of each episode."""
    return [metadata["seed"] for metadata in dataset.storage.get_episode_metadata(range(len(dataset)))]


def replayed(env_id, episode, seed, **parameters):
    """The episode's actions in an environment of one: observations and rewards."""
    env = gym.make(f"wavegym/{env_id}", **parameters)
    observation, _ = env.reset(seed=seed)
    observations, rewards = [observation], []
    for action in episode.actions:
        observation, reward, *_ = env.step(action)
        observations.append(observation)
        rewards.append(reward)
    return np.stack(observations), np.array(rewards)


@pytest.mark.parametrize("env_id", ["KershawEvans-v0", "AgileClutter-v0", "RfEo-v0", "SectorSetup-v0"])
def test_episodes_are_those_of_their_seeds(env_id, tmp_path):
    written = collect(env_id, "myopic", 3, out=tmp_path, seed=5, **SHORT)
    dataset = load(tmp_path, written.id)
    assert seeds(dataset) == [5, 6, 7]
    for seed, episode in zip(seeds(dataset), dataset, strict=True):
        observations, rewards = replayed(env_id, episode, seed, **SHORT)
        np.testing.assert_array_equal(episode.observations, observations)
        np.testing.assert_array_equal(episode.rewards, rewards)
        np.testing.assert_array_equal(episode.infos["cost"][1:], -rewards)
        assert episode.terminations.sum() + episode.truncations.sum() == 1


def test_an_early_end_ends_the_episode(tmp_path):
    dataset = collect("EnergyBudgetKnown-v0", "random", 8, out=tmp_path)
    for episode in dataset:
        assert len(episode.observations) == len(episode.actions) + 1
        assert (episode.terminations | episode.truncations).argmax() == len(episode.actions) - 1


def test_the_environment_comes_back_with_its_parameters(tmp_path):
    dataset = collect("KershawEvans-v0", "myopic", 1, out=tmp_path, q=25.0, **SHORT)
    system = load(tmp_path, dataset.id).recover_environment().unwrapped.system
    assert (system.q, system.horizon) == (25.0, 6)


@pytest.mark.slow
def test_probabilities_are_the_frequencies(tmp_path):
    """Of the first actions of many episodes: the policy's own as often as its probability says, within 4 deviations."""
    dataset = collect(
        "KershawEvans-v0", "fixed:3", 400, out=tmp_path, exploration=0.4, would_choose=["fixed:3"], horizon=2
    )
    episodes, count = list(dataset), dataset.action_space.n
    own = [episode.actions[0] == episode.infos["would_choose"]["fixed:3"][0] for episode in episodes]
    expected = 0.6 + 0.4 / count
    assert abs(np.mean(own) - expected) < 4 * np.sqrt(expected * (1 - expected) / 400)
    for episode, is_own in zip(episodes, own, strict=True):
        assert episode.infos["probability"][0] == pytest.approx(expected if is_own else 0.4 / count)


def test_the_probability_of_several_sensors_is_the_product(tmp_path):
    dataset = collect("AgileClutter-v0", "random", 1, out=tmp_path, horizon=2)
    sizes = dataset.action_space.nvec
    assert len(sizes) == 2
    np.testing.assert_allclose(dataset[0].infos["probability"], 1.0 / (int(sizes[0]) * int(sizes[1])), rtol=1e-15)


def test_a_dataset_does_not_depend_on_its_batches(tmp_path, monkeypatch):
    whole = collect("KershawEvans-v0", "myopic", 5, out=tmp_path / "whole", seed=3, **SHORT)
    monkeypatch.setattr(sys.modules[collect.__module__], "BATCH", 2)
    parts = collect("KershawEvans-v0", "myopic", 5, out=tmp_path / "parts", seed=3, **SHORT)
    assert seeds(parts) == seeds(whole) == [3, 4, 5, 6, 7]
    for one, other in zip(parts, whole, strict=True):
        np.testing.assert_array_equal(one.observations, other.observations)


def test_masked_actions_are_never_explored(tmp_path):
    dataset = collect("EnergyBudgetKnown-v0", "random", 4, out=tmp_path, horizon=12)
    for seed, episode in zip(seeds(dataset), dataset, strict=True):
        replayed("EnergyBudgetKnown-v0", episode, seed, horizon=12)  # the environment refuses a masked action
        assert np.all(episode.infos["probability"] > 0)


def test_returns_of_all_are_those_of_replays(tmp_path):
    dataset = collect("KershawEvans-v0", "myopic", 2, out=tmp_path, exploration=0.5, all_returns=True, **SHORT)
    for seed, episode in zip(seeds(dataset), dataset, strict=True):
        returns = episode.infos["returns"]
        for step, action in [(0, 0), (2, 17), (5, 55)]:
            env = gym.make("wavegym/KershawEvans-v0", **SHORT)
            env.reset(seed=seed)
            for earlier in episode.actions[:step]:
                env.step(earlier)
            choose = env.unwrapped.policy("myopic")
            _, total, terminated, truncated, _ = env.step(action)
            while not (terminated or truncated):
                _, reward, terminated, truncated, _ = env.step(choose())
                total += reward
            assert returns[step, action] == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("limit", [None, 3])
def test_returns_of_all_end_with_each_alternative(limit):
    """Alternatives burn the tank at different rates: 1 / (a + 1) for a + 1 units, then 1 for each unit that is left."""
    left = np.array([2.0, 5.0, 6.0])
    world, taken = Tank(left), np.arange(1.0, 4.0)
    returns = ReturnsOfAll(Burner(), Fixed(0), limit)(Burner().initial(world), world)
    steps = left[:, None] - taken if limit is None else np.minimum(left[:, None] - taken, limit - 1)
    want = np.where(taken <= left[:, None], -(1 / taken + steps), np.nan)
    np.testing.assert_allclose(returns, want, rtol=1e-14)


def test_returns_of_masked_actions_are_nan(tmp_path):
    dataset = collect("EnergyBudgetKnown-v0", "random", 2, out=tmp_path, all_returns=True, horizon=8)
    for episode in dataset:
        taken = episode.infos["returns"][np.arange(len(episode.actions)), episode.actions]
        assert np.isfinite(taken).all()


def test_nothing_is_written_elsewhere(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    collect("KershawEvans-v0", "myopic", 1, out=tmp_path / "data", **SHORT)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data"]
    monkeypatch.setenv("MINARI_DATASETS_PATH", "before")
    with stored_in(tmp_path):
        assert os.environ["MINARI_DATASETS_PATH"] == str(tmp_path)
    assert os.environ["MINARI_DATASETS_PATH"] == "before"


@pytest.mark.parametrize(
    ("env_id", "arguments", "told"),
    [
        ("KershawEvans-v0", {"episodes": 0}, "episodes is 0"),
        ("KershawEvans-v0", {"exploration": 1.5}, "exploration is 1.5"),
        ("KershawEvans-v0", {"policy": "myopik"}, "did you mean 'myopic'"),
        ("KershawEvans-v0", {"would_choose": [3]}, "would_choose has 3"),
        ("RfEo-v0", {"exploration": 0.1}, "a point of a box"),
        ("RfEo-v0", {"all_returns": True}, "no single index"),
        ("AgileClutter-v0", {"all_returns": True}, "action='joint'"),
    ],
)
def test_mistakes_are_told(env_id, arguments, told, tmp_path):
    with pytest.raises(InputError, match=told):
        collect(env_id, **{"policy": "myopic", "episodes": 1, **arguments}, out=tmp_path)


def test_a_dataset_is_not_overwritten_and_a_missing_one_is_named(tmp_path):
    dataset = collect("KershawEvans-v0", "myopic", 1, out=tmp_path, **SHORT)
    with pytest.raises(InputError, match="has a dataset"):
        collect("KershawEvans-v0", "myopic", 1, out=tmp_path, **SHORT)
    with pytest.raises(InputError, match=dataset.id):
        load(tmp_path, "wavegym/KershawEvans/myopik-v0")


@pytest.fixture
def off_policy_evaluation(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "examples" / "offline"))
    import off_policy_evaluation

    monkeypatch.setattr(off_policy_evaluation, "SWEEPS", 10)
    monkeypatch.setattr(off_policy_evaluation, "BATCH", 256)
    return off_policy_evaluation


@pytest.mark.slow
def test_fitted_q_knows_a_policy_that_nobody_played(off_policy_evaluation):
    """The recorded actions are random and cost one and two; a policy that takes only one of them has its cost."""
    rng, episodes, horizon = np.random.default_rng(0), 100, 4
    actions = rng.integers(2, size=(episodes, horizon))
    step = np.broadcast_to(np.linspace(0.0, 1.0, horizon + 1)[:, None], (episodes, horizon + 1, 1))
    data = {"observation": step.astype(np.float32), "action": actions, "cost": 1.0 + actions}
    for action in (0, 1):
        fitted = off_policy_evaluation.fitted_q(data, np.full_like(actions, action), 2)
        assert fitted == pytest.approx(1.0 + action, rel=0.1)


@pytest.mark.slow
def test_the_example_of_off_policy_evaluation_runs(off_policy_evaluation, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["off_policy_evaluation.py", "--episodes", "20", "--worlds", "10"])
    monkeypatch.setattr(off_policy_evaluation, "POLICIES", ("best-fixed", "myopic", "ppo"))
    off_policy_evaluation.main()
    _, *rows, last = capsys.readouterr().out.splitlines()
    assert [row.split()[0] for row in rows] == list(off_policy_evaluation.POLICIES)
    assert all(float(number) > 0 for row in rows for number in row.split()[1:3])
    assert abs(float(last.rsplit(":", 1)[1])) <= 1
