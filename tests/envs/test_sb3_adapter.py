"""The adapter against Stable-Baselines3's own DummyVecEnv over single environments: the same numbers, bit for bit.

Of several vector environments in one batch each row is that of its own part.
"""

from __future__ import annotations

import pickle
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnvWrapper, VecMonitor
from two_sensors import TwoSensors

from wavegym.core.errors import InputError
from wavegym.envs import WaveformEnv, WaveformVectorEnv
from wavegym.envs.sb3 import SB3MixedVecEnv, SB3VecEnv
from wavegym.testing.lockstep import difference

ID = "wavegym/KershawEvansPosition-v0"
COUNT = 3
SETTINGS: dict[str, dict[str, Any]] = {
    "library": {"horizon": 7},
    "box": {"horizon": 7, "action": "box"},
    "truncated": {"horizon": 9, "max_episode_steps": 5},
    "relative": {"horizon": 7, "reward": "relative"},
    **{f"two sensors, {form}": {"system": TwoSensors(action=form)} for form in ("library", "joint", "box")},
}


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


def both(name: str) -> tuple[SB3VecEnv, DummyVecEnv]:
    """Ours over a native batch, theirs over single environments."""
    settings = SETTINGS[name]
    if "system" in settings:
        return SB3VecEnv(partial(WaveformVectorEnv, **settings), COUNT), DummyVecEnv(
            [partial(WaveformEnv, **settings)] * COUNT
        )
    return SB3VecEnv(ID, COUNT, **settings), DummyVecEnv([lambda: gym.make(ID, **settings)] * COUNT)


def assert_same(first: Any, second: Any) -> None:
    assert difference(first, second) is None


def weights(model: Any) -> dict[str, Any]:
    return {name: tensor.numpy() for name, tensor in model.policy.state_dict().items()}


def ppo(env: Any, rollouts: int = 3) -> PPO:
    network = {"net_arch": [16, 16]}
    model = PPO("MlpPolicy", env, n_steps=20, batch_size=30, gamma=0.9, policy_kwargs=network, seed=5, device="cpu")
    return model.learn(rollouts * 20 * COUNT)


def dqn(env: Any) -> DQN:
    model = DQN("MlpPolicy", env, learning_starts=30, batch_size=16, train_freq=1, gradient_steps=2,
                buffer_size=1000, target_update_interval=30, exploration_fraction=0.5,
                policy_kwargs={"net_arch": [16, 16]}, seed=5, device="cpu")  # fmt: skip
    return model.learn(200)


@pytest.mark.parametrize("name", SETTINGS)
def test_every_step_is_dummy_vec_envs(name: str) -> None:
    ours, theirs = both(name)
    ours.seed(7)
    theirs.seed(7)
    assert_same(ours.reset(), theirs.reset())
    assert_same(ours.reset_infos, theirs.reset_infos)
    ended = 0
    theirs.action_space.seed(1)
    for _ in range(23):
        actions = np.stack([theirs.action_space.sample() for _ in range(COUNT)])
        mine, reference = ours.step(actions), theirs.step(actions)
        assert_same(mine[:3], reference[:3])
        assert_same(mine[3], list(reference[3]))
        assert_same(ours.reset_infos, theirs.reset_infos)
        ended += mine[2].sum()
    assert ended == 23 // SETTINGS[name].get("max_episode_steps", ours.batch.system.horizon) * COUNT


@pytest.mark.slow
@pytest.mark.parametrize("name", SETTINGS)
def test_ppo_learns_the_same_weights(name: str) -> None:
    ours, theirs = (ppo(envs) for envs in both(name))
    assert_same(ours.rollout_buffer.rewards, theirs.rollout_buffer.rewards)
    assert_same(weights(ours), weights(theirs))


class Forgetful(VecEnvWrapper):
    """Reports every truncation as a termination."""

    def reset(self) -> Any:
        return self.venv.reset()

    def step_wait(self) -> Any:
        *rest, infos = self.venv.step_wait()
        return *rest, [{**info, "TimeLimit.truncated": False} for info in infos]


def test_only_truncated_episodes_are_bootstrapped() -> None:
    env = SB3VecEnv(ID, COUNT, max_episode_steps=5)
    given, withheld = (
        ppo(e, rollouts=1).rollout_buffer.rewards for e in (env, Forgetful(SB3VecEnv(ID, COUNT, max_episode_steps=5)))
    )
    ends = np.arange(len(given)) % 5 == 4
    assert_same(given[~ends], withheld[~ends])
    assert (given[ends] != withheld[ends]).all()
    terminated = ppo(SB3VecEnv(ID, COUNT, horizon=5), rollouts=1).rollout_buffer.rewards
    assert_same(terminated, ppo(Forgetful(SB3VecEnv(ID, COUNT, horizon=5)), rollouts=1).rollout_buffer.rewards)


@pytest.mark.parametrize("name", ["library", "truncated", "relative", "two sensors, joint"])
def test_dqn_learns_the_same_weights(name: str) -> None:
    ours, theirs = (dqn(envs) for envs in both(name))
    assert ours.replay_buffer is not None
    assert theirs.replay_buffer is not None
    assert_same(ours.replay_buffer.timeouts, theirs.replay_buffer.timeouts)
    assert ours.replay_buffer.timeouts.any() == (name == "truncated")
    assert_same(weights(ours), weights(theirs))


def test_an_environments_own_seeds_reach_it_once() -> None:
    env = SB3VecEnv(ID, COUNT)
    seeds = [2**100 + 1, 5, 2**90]
    env.seed(seeds)
    first = env.reset()
    second = env.reset()
    alone = [gym.make(ID) for _ in seeds]
    assert_same(first, np.stack([e.reset(seed=s)[0] for e, s in zip(alone, seeds, strict=True)]))
    assert_same(second, np.stack([e.reset()[0] for e in alone]))
    with pytest.raises(InputError, match="2 entries, expected 3"):
        env.seed([1, 2])


def test_options_reach_the_next_reset_and_must_agree() -> None:
    env = SB3VecEnv(ID, COUNT)
    before = env.reset()
    only_first = np.array([True, False, False])
    env.set_options({"reset_mask": only_first})
    after = env.reset()
    assert (before[1:] == after[1:]).all()
    assert (before[0] != after[0]).any()
    assert (env.reset() != after).any(axis=1).all()
    env.set_options([{"colour": 1}, {}, {}])
    with pytest.raises(InputError, match="options differ"):
        env.reset()


def test_methods_and_attributes_are_shared_out() -> None:
    env = SB3VecEnv(ID, COUNT, horizon=8)
    env.reset()
    masks = env.env_method("action_masks")
    assert [mask.shape for mask in masks] == [(env.action_space.n,)] * COUNT
    assert len(env.env_method("action_masks", indices=[0, 2])) == 2
    assert env.get_attr("action_space") == [env.action_space] * COUNT
    assert [system.horizon for system in env.get_attr("system", indices=1)] == [8]
    (belief,) = env.get_attr("belief", indices=[2])
    assert (belief.mean == env.batch.belief.mean[2:]).all()
    assert env.env_is_wrapped(gym.wrappers.TimeLimit) == [False] * COUNT
    assert env.has_attr("system")
    assert not env.has_attr("no_such_thing")
    env.set_attr("max_episode_steps", 2)
    assert env.get_attr("max_episode_steps") == [2] * COUNT
    assert not env.step(np.zeros(COUNT, np.int64))[2].any()
    assert env.step(np.zeros(COUNT, np.int64))[2].all()
    with pytest.raises(InputError, match="share one batch"):
        env.set_attr("max_episode_steps", 3, indices=[0])


def test_parameters_change_at_a_reset() -> None:
    env = SB3VecEnv(ID, num_envs=COUNT)
    env.set_options({"parameters": {"q": 7.0}})
    env.seed(5)
    changed, fresh = env.reset(), SB3VecEnv(ID, num_envs=COUNT, q=7.0)
    fresh.seed(5)
    np.testing.assert_array_equal(changed, fresh.reset())
    assert env.get_attr("system")[0].q == 7.0
    with pytest.raises(InputError, match="q is fixed in an episode"):
        env.set_attr("q", 1.0)
    np.testing.assert_array_equal(env.step(np.zeros(COUNT, np.int64))[1], fresh.step(np.zeros(COUNT, np.int64))[1])


def test_pickled_in_the_middle_of_an_episode_it_goes_on() -> None:
    env = SB3VecEnv(ID, COUNT, horizon=6, reward="relative")
    env.seed(3)
    env.reset()
    actions = np.arange(COUNT)
    for _ in range(4):
        env.step(actions)
    copy = pickle.loads(pickle.dumps(env))
    for _ in range(9):
        for a, b in zip(copy.step(actions), env.step(actions), strict=True):
            assert_same(a, b)


def test_monitored_episodes_are_counted() -> None:
    env = VecMonitor(SB3VecEnv(ID, COUNT, horizon=4))
    env.reset()
    total = sum(env.step(np.zeros(COUNT, np.int64))[1] for _ in range(3))
    _, rewards, _, infos = env.step(np.zeros(COUNT, np.int64))
    assert [info["episode"]["l"] for info in infos] == [4] * COUNT
    assert [info["episode"]["r"] for info in infos] == pytest.approx((total + rewards).tolist(), rel=1e-6)


def test_a_factory_must_reset_in_the_same_step() -> None:
    def factory(num_envs: int, autoreset_mode: str) -> WaveformVectorEnv:
        return WaveformVectorEnv(
            "wavegym.systems.kershaw_evans.system:KershawEvans", num_envs, autoreset_mode="NextStep"
        )

    with pytest.raises(InputError, match="autoreset mode"):
        SB3VecEnv(factory, COUNT)


def test_images_are_frames_only_where_asked_for() -> None:
    env = SB3VecEnv(ID, 2, render_mode="rgb_array")
    env.reset()
    images = env.get_images()
    assert [image.dtype for image in images if image is not None] == [np.uint8, np.uint8]
    assert env.render().shape[2] == 3
    blind = SB3VecEnv(ID, 2)
    blind.reset()
    with pytest.warns(UserWarning, match="rgb_array"):
        assert blind.get_images() == [None, None]


def parts() -> list[SB3VecEnv]:
    return [SB3VecEnv(ID, count, horizon=4, q=q) for count, q in ((2, 1.0), (3, 10.0))]


def test_every_step_is_that_of_the_parts() -> None:
    mixed, (few, many) = SB3MixedVecEnv(parts()), parts()
    mixed.seed([3, 4, 5, 6, 7])
    few.seed([3, 4])
    many.seed([5, 6, 7])
    assert difference(mixed.reset(), np.concatenate([few.reset(), many.reset()])) is None
    rng, ended = np.random.default_rng(0), 0
    for _ in range(9):
        actions = rng.integers(mixed.action_space.n, size=5)
        (*rows, infos), first, second = mixed.step(actions), few.step(actions[:2]), many.step(actions[2:])
        for got, a, b in zip(rows, first[:3], second[:3], strict=True):
            assert difference(got, np.concatenate([a, b])) is None
        assert difference(infos, [*first[3], *second[3]]) is None
        assert difference(mixed.reset_infos, [*few.reset_infos, *many.reset_infos]) is None
        ended += rows[2].sum()
    assert ended == 10
    assert (
        difference(mixed.env_method("action_masks"), few.env_method("action_masks") + many.env_method("action_masks"))
        is None
    )
    assert [system.q for system in mixed.get_attr("system")] == [1.0, 1.0, 10.0, 10.0, 10.0]
    assert [system.q for system in mixed.get_attr("system", indices=[0, 4])] == [1.0, 10.0]
    assert mixed.env_is_wrapped(object, indices=3) == [False]


def test_seeds_count_on_over_the_parts() -> None:
    mixed, few = SB3MixedVecEnv(parts()), parts()[1]
    mixed.seed(3)
    few.seed(5)
    assert difference(mixed.reset()[2:], few.reset()) is None
    with pytest.raises(InputError, match="seed has 2 entries, expected 5: one for each environment"):
        mixed.seed([3, 4])


def test_an_attribute_is_set_for_all_or_for_none() -> None:
    mixed = SB3MixedVecEnv(parts())
    mixed.set_attr("mark", 7)
    assert mixed.get_attr("mark") == [7] * 5
    with pytest.raises(InputError, match="mark cannot be set for some environments, expected all"):
        mixed.set_attr("mark", 8, indices=[0, 1])


@pytest.mark.parametrize(
    ("other", "name"), [({"action": "box"}, "action_space"), ({"reward": "cost", "forecasts": True}, "observation")]
)
def test_parts_have_the_same_spaces(other: dict[str, Any], name: str) -> None:
    with pytest.raises(InputError, match=f"{name}.* of part 1 is .*, expected that of part 0"):
        SB3MixedVecEnv([SB3VecEnv(ID, 2), SB3VecEnv(ID, 2, **other)])
