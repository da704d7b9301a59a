"""The three autoreset modes and partial resets, spelled out."""

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
    """Environment 0 stands one step behind environment 1, which has just ended; returns what the last step gave."""
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


def test_next_step_resets_one_while_the_other_goes_on():
    env, (_, _, terminated, _, _) = out_of_step("NextStep")
    assert terminated.tolist() == [False, True]
    twin, _ = out_of_step("Disabled")
    want = twin.episodes.system.transition(twin.episodes.state, np.array([7, 7]), twin.world)
    observations, rewards, terminated, truncated, info = env.step(np.array([7, 7]))
    assert env.belief.step.tolist() == [HORIZON, 0]
    assert terminated.tolist() == [True, False]
    assert not truncated.any()
    assert rewards[0] == -env.system.cost(want.belief)[0]
    assert rewards[1] == 0.0
    assert info["_waveform"].tolist() == [True, False]
    assert info["_cost"].tolist() == [True, True]
    assert observations[1, -1] == pytest.approx((1.0 - 0.5) / 0.3, rel=1e-6)  # the whole time is left


def test_the_action_of_a_resetting_environment_is_ignored_whatever_it_is():
    one, two = (out_of_step("NextStep")[0] for _ in range(2))
    for got, want in zip(one.step(np.array([7, -99]))[:4], two.step(np.array([7, 0]))[:4], strict=True):
        assert (got == want).all()


def test_same_step_puts_the_last_observation_and_info_aside():
    _, (last, rewards, *_) = out_of_step("Disabled")
    env, (observations, again, terminated, _, info) = out_of_step("SameStep")
    assert (again == rewards).all()
    assert terminated.tolist() == [False, True]
    assert env.belief.step.tolist() == [HORIZON - 1, 0]
    assert info["final_obs"][0] is None
    assert (info["final_obs"][1] == last[1]).all()
    assert (observations[0] == last[0]).all()
    assert (observations[1] != last[1]).any()
    assert info["_final_info"].tolist() == [False, True]
    assert info["final_info"]["cost"][1] == -rewards[1]
    assert info["final_info"]["_waveform"].tolist() == [False, True]
    assert info["_waveform"].tolist() == [True, False]
    assert info["cost"][1] == env.system.cost(env.belief)[1]


def test_disabled_refuses_a_step_past_the_end_and_stays_as_it_was():
    env, _ = out_of_step("Disabled")
    before = env.episodes.state.belief
    with pytest.raises(InputError, match=r"environments \[1\] have ended, expected a reset"):
        env.step(np.array([0, 0]))
    assert env.episodes.state.belief is before
    env.reset(options={"reset_mask": np.array([False, True])})
    assert env.step(np.array([0, 0]))[2].tolist() == [True, False]


def test_a_partial_reset_leaves_the_others_and_the_callers_options_alone():
    env = make("Disabled", 3)
    env.reset(seed=0)
    before, *_ = env.step(np.array([1, 2, 3]))
    options = {"reset_mask": np.array([False, True, False])}
    observations, info = env.reset(seed=[None, 9, None], options=options)
    assert list(options) == ["reset_mask"]
    assert options["reset_mask"].tolist() == [False, True, False]
    assert (observations[[0, 2]] == before[[0, 2]]).all()
    assert (observations[1] == make("Disabled", 3).reset(seed=8)[0][1]).all()
    assert info["_cost"].tolist() == [False, True, False]
    assert info["cost"][0] == 0.0


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
