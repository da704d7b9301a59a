"""Autoreset modes and partial resets: what they refuse. What they return is in test_vector_equals_sync.py."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from wavegym.core.errors import InputError
from wavegym.envs import WaveformEnv, WaveformVectorEnv
from wavegym.systems.kershaw_evans.system import KershawEvans

HORIZON = 4


def make(mode, num_envs=2, **settings):
    return WaveformVectorEnv(KershawEvans(horizon=HORIZON), num_envs, autoreset_mode=mode, **settings)


def out_of_step(mode):
    """Environment 0 is one step behind environment 1, which has just ended; returns the result of the last step."""
    env = make(mode)
    env.reset(seed=0)
    env.step(np.array([0, 0]))
    env.reset(options={"reset_mask": np.array([True, False])})
    for _ in range(HORIZON - 1):
        result = env.step(np.array([3, 3]))
    return env, result


def test_the_mode_is_an_enum_in_the_metadata_of_each_environment_alone():
    for mode in AutoresetMode:
        assert make(mode.value).metadata["autoreset_mode"] is mode
        with pytest.raises(InputError, match=f"expected the string '{mode.value}'"):
            make(mode)
    assert "autoreset_mode" not in WaveformVectorEnv.metadata


def test_the_action_of_a_resetting_environment_is_ignored_whatever_it_is():
    one, two = (out_of_step("NextStep")[0] for _ in range(2))
    for got, want in zip(one.step(np.array([7, -99]))[:4], two.step(np.array([7, 0]))[:4], strict=True):
        assert (got == want).all()


def test_disabled_refuses_a_step_past_the_end_and_stays_as_it_was():
    env, _ = out_of_step("Disabled")
    before = env.episodes.state.belief
    with pytest.raises(InputError, match=r"environments \[1\] have ended, expected a reset"):
        env.step(np.array([0, 0]))
    assert env.episodes.state.belief is before
    env.reset(options={"reset_mask": np.array([False, True])})
    assert env.step(np.array([0, 0]))[2].tolist() == [True, False]


def test_a_partial_reset_remembers_which_others_have_ended():
    """Both have ended and one is reset: the other begins anew in the next step, or that step is refused."""
    for mode in ("NextStep", "Disabled"):
        env = make(mode)
        env.reset(seed=0)
        for _ in range(HORIZON):
            env.step(np.array([0, 0]))
        env.reset(options={"reset_mask": np.array([True, False])})
        if mode == "Disabled":
            with pytest.raises(InputError, match=r"environments \[1\] have ended, expected a reset"):
                env.step(np.array([0, 0]))
        else:
            rewards = env.step(np.array([0, 0]))[1]
            assert env.belief.step.tolist() == [1, 0]
            assert rewards[0] < 0.0
            assert rewards[1] == 0.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"reset_mask": [True, False]}, "reset_mask"),
        ({"reset_mask": np.array([1, 0])}, "reset_mask"),
        ({"reset_mask": np.array([True])}, "reset_mask"),
        ({"reset_mask": np.zeros(2, np.bool_)}, "not all False"),
        ({"reset_maks": np.ones(2, np.bool_)}, "did you mean 'reset_mask'"),
    ],
)
def test_wrong_options_are_refused(options, message):
    env = make("NextStep")
    env.reset(seed=0)
    with pytest.raises(InputError, match=message):
        env.reset(options=options)


def test_first_things_first():
    with pytest.raises(InputError, match=r"expected reset\(\) first"):
        make("NextStep").step(np.array([0, 0]))
    with pytest.raises(InputError, match=r"expected reset\(\) first"):
        make("NextStep").reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(InputError, match="seed has 3 entries, expected 2"):
        make("NextStep").reset(seed=[1, 2, 3])
    with pytest.raises(InputError, match="did you mean 'SameStep'"):
        make("SameStp")
    with pytest.raises(InputError, match="num_envs is 0"):
        make("SameStep", 0)
    for limit in (-1, 0, 2.5):
        with pytest.raises(InputError, match=f"max_episode_steps is {limit}, expected an integer >= 1"):
            make("SameStep", max_episode_steps=limit)
    with pytest.raises(InputError, match=r"expected reset\(\) first"):
        make("SameStep", render_mode="rgb_array").render()
    single = WaveformEnv(KershawEvans(), render_mode="rgb_array")
    with pytest.raises(InputError, match=r"expected reset\(\) first"):
        single.render()


@pytest.mark.parametrize("setting", [{"autoreset_mode": "SameStep"}, {"num_envs": 3}])
def test_the_single_environment_has_no_settings_of_a_batch(setting):
    (name,) = setting
    with pytest.raises(
        InputError, match=rf"{name} is a setting of vector environments, expected gym.make_vec\(id, {name}"
    ):
        WaveformEnv(KershawEvans, **setting)
    with pytest.raises(InputError, match=name):
        gym.make("wavegym/KershawEvans-v0", **setting)


def test_the_single_environment_refuses_a_step_past_the_end():
    env = gym.make("wavegym/KershawEvans-v0", horizon=2).unwrapped
    env.reset(seed=0)
    env.step(0)
    assert env.step(0)[2] is True
    with pytest.raises(InputError, match="the episode has ended"):
        env.step(0)
    env.reset()
    assert env.step(0)[2] is False
