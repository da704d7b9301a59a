"""Every id in RLlib: what its workers make, masks beside the observations, and the example on two workers."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("ray.rllib", reason="RLlib is not installed: make test-oldest has it")

import ray
from test_docs_how_to import run

from wavegym.core.errors import InputError
from wavegym.evaluation import compare
from wavegym.integrations.ray import make, register_envs

MASKED = "wavegym/EnergyBudgetKnown-v0"
SCRIPT = Path(__file__).parents[2] / "examples" / "rllib" / "ppo.py"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("rllib_example", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def two_workers():
    ray.init(address="local", num_cpus=3, include_dashboard=False, log_to_driver=False)  # the learner takes one
    register_envs()
    yield
    ray.shutdown()


def test_masks_stand_beside_the_observation_of_a_single_environment():
    plain, masked = gym.make(MASKED), make(gym.spec(MASKED), {"masks": True})
    (wanted, _), (found, _) = plain.reset(seed=3), masked.reset(seed=3)
    for _ in range(20):
        assert masked.observation_space.contains(found)
        np.testing.assert_array_equal(found["observations"], wanted)
        np.testing.assert_array_equal(found["action_mask"], plain.unwrapped.action_masks())
        action = int(np.flatnonzero(found["action_mask"])[-1])
        wanted, found = plain.step(action)[0], masked.step(action)[0]


def test_masks_stand_beside_the_observations_of_a_batch():
    settings = {"horizon": 6}
    plain = gym.make_vec(MASKED, num_envs=4, **settings)
    masked = make(gym.spec(MASKED), {"masks": True, "num_envs": 4, **settings})
    (wanted, _), (found, _) = plain.reset(seed=3), masked.reset(seed=3)
    for _ in range(9):  # beyond the episodes' end
        assert masked.observation_space.contains(found)
        np.testing.assert_array_equal(found["observations"], wanted)
        np.testing.assert_array_equal(found["action_mask"], plain.unwrapped.action_masks())
        actions = found["action_mask"].argmax(axis=1)
        wanted, found = plain.step(actions)[0], masked.step(actions)[0]


def test_masks_of_several_choices_are_refused():
    with pytest.raises(InputError, match="expected a Discrete one"):
        make(gym.spec("wavegym/AgileClutter-v0"), {"masks": True})


def test_the_configuration_of_the_page_samples_from_every_worker(two_workers):
    page: dict = {}
    run("how_to/cluster.md", page)
    config = page["config"].training(train_batch_size=640, minibatch_size=320, num_epochs=1)
    algorithm = config.env_runners(rollout_fragment_length=10).build_algo()
    sampled = algorithm.train()["env_runners"]["num_env_steps_sampled"]
    algorithm.stop()
    assert sampled == 640


@pytest.mark.parametrize("mode", gym.VectorizeMode)
def test_a_plain_id_is_sampled_by_workers(two_workers, mode):
    from ray.rllib.algorithms.ppo import PPOConfig

    if mode is gym.VectorizeMode.ASYNC:
        pytest.skip("RLlib's own processes for each environment: nothing of wavegym is in between")
    config = PPOConfig().environment("wavegym/KershawEvans-v0", env_config={"horizon": 5})
    config = config.env_runners(
        num_env_runners=2, num_envs_per_env_runner=3, gym_env_vectorize_mode=mode, rollout_fragment_length=10
    )
    algorithm = config.training(train_batch_size=60, minibatch_size=30, num_epochs=1).build_algo()
    episodes = algorithm.train()["env_runners"]["episode_len_mean"]
    algorithm.stop()
    assert episodes == 5.0


@pytest.mark.slow
def test_the_example_trains_on_two_workers_and_learns(two_workers, example):
    """Better than chance after 32 000 steps, on the test worlds of a comparison."""
    env_id = "wavegym/KershawEvansPosition-v0"
    policy = example.train(env_id, masks=False, steps=32_000, workers=2, envs=16, seed=0)
    comparison = compare(env_id, {"rllib": policy, "random": None}, worlds=50, jobs=1, progress=False)
    ratio = np.log(comparison.cost("rllib")[0] / comparison.cost("random")[0])
    assert ratio.mean() + 3 * ratio.std() / np.sqrt(len(ratio)) < 0


def test_the_example_with_masks_never_chooses_a_forbidden_action(two_workers, example):
    """A forbidden action would end the training, or the comparison, with an error."""
    policy = example.train(MASKED, masks=True, steps=3200, workers=2, envs=16, seed=0)
    assert np.isfinite(compare(MASKED, {"rllib": policy}, worlds=20, jobs=1, progress=False).cost("rllib")).all()
