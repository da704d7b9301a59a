"""Scenario files: written for every id and read back, closed keys, and keywords that win."""

from __future__ import annotations

import dataclasses
import tomllib

import gymnasium as gym
import numpy as np
import pytest

import wavegym
from wavegym.core.errors import InputError
from wavegym.core.parameters import parameter_infos
from wavegym.envs.sb3 import SB3VecEnv
from wavegym.envs.scenario import scenario_differences, scenario_toml
from wavegym.evaluation import compare, make_task
from wavegym.registration import SYSTEMS
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition

ID = "wavegym/KershawEvansPosition-v0"
NARROW = "tests/Narrow-v0"


@pytest.fixture
def write(tmp_path):
    def written(text, name="mine.toml"):
        (tmp_path / name).write_text(text)
        return str(tmp_path / name)

    return written


@pytest.fixture
def narrow():
    wavegym.register(NARROW, "wavegym.systems.kershaw_evans.system:KershawEvans", q=9.0, horizon=7)
    yield
    del gym.registry[NARROW]


def system_of(*arguments, **named):
    return gym.make(*arguments, **named).unwrapped.system


@pytest.mark.parametrize("id", SYSTEMS)
def test_every_environment_written_out_reads_back_the_same(id, write):
    text = scenario_toml(id)
    file, usual = write(text), system_of(id)
    assert system_of(id, scenario=file) == usual
    assert gym.make_vec(id, 2, scenario=file).system == usual
    stated = tomllib.loads(text)
    for info in parameter_infos(type(usual)):
        if info.name == "truth":
            continue
        assert info.name in stated or getattr(usual, info.name) is None
        assert f"\n{info.name} = " in text or f"\n# {info.name} = " in text
        assert info.unit in text
        assert " ".join(info.description.split()[:3]) in text.replace("\n# ", " ")
    assert scenario_differences(id, file) == {}


@pytest.mark.parametrize("id", SYSTEMS)
def test_every_parameter_of_the_file_arrives(id, write):
    """Another horizon, and one parameter that is given to the world."""
    usual = system_of(id)
    names = ("q", "sigma", "targets")
    free = [info.name for info in parameter_infos(type(usual)) if info.truth and info.name in names]
    changed = {"horizon": usual.horizon - 1, "truth": {name: getattr(usual, name) for name in free}}
    file = write(scenario_toml(id, **changed))
    assert system_of(id, scenario=file) == dataclasses.replace(usual, **changed)
    assert free


def test_a_file_with_a_truth_a_reward_and_a_comment_is_what_its_keywords_are(write):
    file = write(f'id = "{ID}"\nq = 50  # m^2/s^3\nweights = [1, 0]\nreward = "log-cost"\n[truth]\nq = 80.0\n')
    (by_file, by_words) = (
        gym.make_vec(ID, 3, **given)
        for given in ({"scenario": file}, {"q": 50.0, "reward": "log-cost", "truth": {"q": 80.0}})
    )
    assert by_file.system == by_words.system == KershawEvansPosition(q=50.0, truth={"q": 80.0})
    for envs in (by_file, by_words):
        envs.reset(seed=3)
    steps = [envs.step(np.array([1, 2, 3])) for envs in (by_file, by_words)]
    np.testing.assert_array_equal(steps[0][1], steps[1][1])
    np.testing.assert_array_equal(steps[0][0], steps[1][0])


def test_a_file_may_state_what_is_observed(write):
    by_file = gym.make_vec(ID, 2, scenario=write('observation = "measurements"\n'))
    by_words = gym.make_vec(ID, 2, observation="measurements")
    assert by_file.single_observation_space == by_words.single_observation_space
    assert by_file.single_observation_space != gym.make_vec(ID, 2).single_observation_space


def test_keywords_win_over_the_file_and_the_file_over_the_registration(write, narrow):
    file = write("q = 4.0\n[truth]\nreference_range = 40e3\n")
    assert system_of(NARROW) == KershawEvans(q=9.0, horizon=7)
    truth = {"reference_range": 40e3}
    assert system_of(NARROW, scenario=file) == KershawEvans(q=4.0, horizon=7, truth=truth)
    assert system_of(NARROW, scenario=file, q=2.0) == KershawEvans(q=2.0, horizon=7, truth=truth)
    assert system_of(NARROW, scenario=file, truth=None) == KershawEvans(q=4.0, horizon=7)
    assert make_task(NARROW, {"scenario": file, "horizon": 3}).system == KershawEvans(q=4.0, horizon=3, truth=truth)
    assert SB3VecEnv(NARROW, 2, scenario=file).batch.system.q == 4.0


def test_a_registration_may_have_a_scenario(write):
    file = write(f'id = "{ID}"\nq = 4.0\n')
    wavegym.register(NARROW, KershawEvansPosition, scenario=file, horizon=7)
    try:
        assert system_of(NARROW) == make_task(NARROW, {}).system == KershawEvansPosition(q=4.0, horizon=7)
    finally:
        del gym.registry[NARROW]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("horizn = 5", r"KershawEvansPosition has no 'horizn'; did you mean 'horizon'\?"),
        ("idd = 5", r"did you mean 'id'\?"),
        ("[system]\nq = 5.0", "KershawEvansPosition has no 'system'"),
        ("[truth]\nqq = 5.0", r"truth has 'qq', expected one of .*; did you mean 'q'\?"),
        ("[truth]\nhorizon = 5", "truth has 'horizon', expected one of "),
        ("q = -1.0", "q is -1.0 m.*, expected .* >= 0"),
        ("num_envs = 4", "has 'num_envs', expected it in gym.make or gym.make_vec"),
        ("max_episode_steps = 4", "has 'max_episode_steps', expected it in gym.make"),
        ('reward = "relativ"', r"did you mean 'relative'\?"),
        ('id = "wavegym/RfEo-v0"', "is for wavegym/RfEo-v0, expected one for KershawEvansPosition"),
        ('id = "RfEo-v7"', "did you mean 'wavegym/RfEo-v0'"),
        ("id = 3", "id is 3, expected a string"),
        ("q = ", "cannot be read"),
    ],
)
def test_a_mistake_in_a_file_is_one_line(text, words, write):
    with pytest.raises(InputError, match=words) as caught:
        gym.make(ID, scenario=write(text))
    assert "\n" not in str(caught.value)


def test_paths_start_at_the_file_s_folder(tmp_path, write):
    lines = [f"{t},a,{20e3 + 150 * t},{5e3 - 20 * t},3000" for t in range(0, 120, 2)]
    write("\n".join(["time_s,id,x_m,y_m,z_m", *lines]), "boat.csv")
    file = write('targets = "recorded"\ntracks = "boat.csv"\nradar = [100.0, 50.0, 0.0]\nhorizon = 20\n')
    system = system_of(ID, scenario=file)
    assert system.tracks == tmp_path / "boat.csv"
    again = write(scenario_toml(ID, scenario=file), "again.toml")
    assert system_of(ID, scenario=again) == system


def test_what_toml_cannot_hold_is_named():
    with pytest.raises(InputError, match=r"tracker cannot be written: value is .*TOML has nothing else"):
        scenario_toml(ID, tracker=_Still())


class _Still:
    def predict(self, estimate, motion):
        return estimate

    def update(self, estimate, scan):
        return estimate


def test_a_comparison_records_values_that_differ_and_not_the_file(write):
    file = write(scenario_toml(ID, q=50.0, truth={"q": 80.0}))
    settings = {"q": 50.0, "truth": {"q": 80.0}}
    assert make_task(ID, {"scenario": file}).parameters == settings
    by_file, by_words = (compare(ID, ["random"], worlds=3, jobs=1, **given) for given in ({"scenario": file}, settings))
    np.testing.assert_array_equal(by_file.cost("random"), by_words.cost("random"))


def test_classes_take_no_file(write):
    with pytest.raises(InputError, match=r"scenario is a setting of gym\.make"):
        wavegym.envs.WaveformVectorEnv(KershawEvans, scenario=write(""))


def test_a_specification_with_a_scenario_survives_json(write):
    env = gym.make(ID, scenario=write("q = 50.0"))
    again = gym.envs.registration.EnvSpec.from_json(env.spec.to_json())
    assert gym.make(again).unwrapped.system.q == 50.0
