"""Policies of other people: functions, models with ``predict``, saved models, factories."""

from __future__ import annotations

import sys
import types
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from evaluation_systems import Uneven
from gymnasium import spaces

from wavegym.core.errors import InputError
from wavegym.envs.sb3 import SB3VecEnv
from wavegym.evaluation import Factory, adapters, as_policy, compare, draw_worlds, make_task, world_seeds
from wavegym.evaluation.play import play
from wavegym.observations.observer import Observer
from wavegym.schedulers import Fixed, Myopic

ID = "wavegym/KershawEvansPosition-v0"
UNEVEN = "tests/Uneven-v0"
TASK = make_task(ID, {"horizon": 4})
SEEDS = world_seeds(0, "tune", 3)


def by_range(observation):
    """An index that depends on what is observed."""
    return (np.abs(observation[:, 0]) * 10).astype(np.int64) % 56


def same_play(one, other, task=TASK):
    for a, b in zip(play(task, one, SEEDS)[:-1], play(task, other, SEEDS)[:-1], strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_function_is_shown_what_an_agent_is_shown():
    shown = []
    policy = as_policy(lambda observation: shown.append(observation) or by_range(observation))
    play(TASK, policy, SEEDS)
    assert {each.shape for each in shown} == {(3, len(TASK.system.observation_fields))}
    assert {each.dtype for each in shown} == {np.dtype(np.float32)}
    assert len(shown) == 4


def test_a_policy_without_an_environment_makes_its_observations_itself():
    policy = as_policy(by_range)
    policy.begin(TASK.system, 3, np.random.default_rng(0))
    belief = TASK.system.initial(draw_worlds(TASK.system, SEEDS)).belief
    shown, _ = Observer(TASK.system)(belief)
    np.testing.assert_array_equal(policy.act(belief, None, None), by_range(shown))


def test_everything_is_compared_in_one_call(tmp_path):
    given = {
        "function": lambda observation: np.full(len(observation), 7),
        "policy": Fixed(7),
        "runs": [Fixed(7), lambda observation: np.full(len(observation), 7)],
        "factory": Factory(lambda system: Fixed(len(system.candidates()) - 49)),
        "name": "fixed:7",
        "fixed:7": None,
    }
    comparison = compare(ID, given, worlds=3, jobs=1, horizon=4)
    for name in given:
        for member in comparison.cost(name):
            np.testing.assert_array_equal(member, comparison.cost("fixed:7")[0])
    assert comparison.cost("runs").shape == (2, 3)


def test_a_policy_stays_itself():
    policy = Myopic()
    assert as_policy(policy) is policy


class Model:
    """Predicts what a recurrent, masked model would be asked for."""

    def __init__(self, space=None):
        self.calls = []
        if space is not None:
            self.observation_space = space

    def predict(self, observation, state=None, episode_start=None, deterministic=False, action_masks=None):
        self.calls.append((state, episode_start.tolist(), deterministic, action_masks))
        return np.zeros(len(observation), np.int64), len(self.calls)


def test_a_model_is_asked_for_deterministic_actions_with_its_own_state():
    model = Model()
    play(TASK, as_policy(model), SEEDS)
    assert [call[0] for call in model.calls] == [None, 1, 2, 3]
    assert model.calls[0][1:] == ([True] * 3, True, None)
    assert model.calls[1][1] == [False] * 3


def test_a_model_trained_with_forecasts_is_shown_them():
    fields = len(Observer(TASK.system, forecasts=True).observation_fields)
    model = Model(spaces.Box(-10, 10, (fields,)))
    shown = []
    predict = model.predict
    model.predict = lambda observation, **given: (
        shown.append(observation.shape) or predict(observation, None, np.zeros(3), **given)
    )
    play(TASK, as_policy(model), SEEDS)
    assert set(shown) == {(3, fields)}


class Masked(Uneven):
    """The first action is allowed in the first two steps only."""

    def mask(self, belief):
        allowed = np.ones((len(belief.step), 3), np.bool_)
        allowed[belief.step >= 2, 0] = False
        return allowed


class FirstAllowed:
    """A masked model."""

    def predict(self, observation, deterministic=True, action_masks=None):
        return action_masks.argmax(axis=1), None


def test_a_model_that_knows_masks_is_given_them():
    task = make_task(UNEVEN, {})
    task = type(task)(task.env_id, Masked(), None, {})
    played = play(task, as_policy(FirstAllowed()), SEEDS)
    ran = played.choice[:, :, 0] >= 0
    wanted = np.where(np.arange(played.choice.shape[1]) < 2, 0, 1)
    np.testing.assert_array_equal(played.choice[:, :, 0][ran], np.broadcast_to(wanted, ran.shape)[ran])


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (lambda o: np.zeros(len(o)), "returned ndarray of the type float64, expected integers"),
        (lambda o: np.zeros((len(o), 2), np.int64), r"actions of the shape \(1, 2\), expected \(1,\): axis 0"),
        (lambda o: 3, r"actions of the shape \(\), expected \(1,\)"),
        (lambda o: np.full(len(o), 99), r"action is 99, expected an index in \[0, 55\]"),
        (lambda system: Myopic(), "returned Myopic of the type object.*that makes a policy is a Factory"),
        (Myopic, "is the class Myopic, expected an object of it, or a Factory"),
        (3, "is 3, expected a Policy, a function of the observation"),
        ([], "is an empty sequence"),
        (Model(spaces.Box(-1, 1, (77,))), "takes observations of 77 elements, expected 6, or 62 with forecasts"),
        (types.SimpleNamespace(predict=len, action_space=spaces.Discrete(3)), r"chooses from Discrete\(3\)"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_one_line_that_names_the_policy(given, words):
    with pytest.raises(InputError, match=f"^policy 'mine'.*{words}") as caught:
        compare(ID, {"mine": given}, worlds=2, jobs=1, horizon=4)
    assert "\n" not in str(caught.value)


def test_points_of_a_box_have_their_shape():
    task = make_task(ID, {"horizon": 4, "action": "box"})
    play(task, as_policy(lambda observation: np.zeros((len(observation), 2))), SEEDS)
    with pytest.raises(InputError, match=r"'<?function>?' returned actions of the shape \(3,\), expected \(3, 2\)"):
        play(task, as_policy(lambda observation: np.zeros(len(observation))), SEEDS)


def test_names_and_folders_need_an_environment():
    with pytest.raises(InputError, match="'myopic' depends on the environment, expected its id"):
        as_policy("myopic")
    assert isinstance(as_policy("myopic", ID), Myopic)
    runs = Path(__file__).parents[2] / "results" / "runs" / "KershawEvansPosition" / "ppo"
    with pytest.raises(InputError, match=r"'.*ppo' has 3 training runs, expected one"):
        as_policy(runs, ID)


def test_code_runs_only_if_it_is_trusted(monkeypatch, tmp_path):
    code = "from wavegym.schedulers import Fixed\nmake = lambda system: Fixed(3)\n"
    (tmp_path / "their_policies.py").write_text(code)
    monkeypatch.syspath_prepend(str(tmp_path))
    source = "their_policies:make"
    with pytest.raises(InputError, match=f"^policy is '{source}'; loading it runs code of .*--trust, or trust=True"):
        compare(ID, {source: None}, worlds=2, jobs=1, horizon=4)
    assert "their_policies" not in sys.modules
    comparison = compare(ID, {source: None, "fixed:3": None}, worlds=2, jobs=1, horizon=4, trust=True)
    np.testing.assert_array_equal(comparison.cost(source), comparison.cost("fixed:3"))
    with pytest.raises(InputError, match=r"cannot be loaded: .*no attribute 'mak'"):
        as_policy("their_policies:mak", ID, trust=True)
    monkeypatch.delitem(sys.modules, "their_policies")


def test_a_file_that_is_no_saved_model_is_named(tmp_path):
    file = tmp_path / "model.zip"
    with pytest.raises(InputError, match=r"model\.zip' is no file"):
        as_policy(file, ID, trust=True)
    file.write_text("nothing")
    with pytest.raises(InputError, match=r"model\.zip'; loading it runs code of the file, expected --trust"):
        as_policy(file, ID)
    with pytest.raises(InputError, match=r"model\.zip', expected a model that Stable-Baselines3 saved") as caught:
        as_policy(file, ID, trust=True)
    assert "\n" not in str(caught.value)


def test_agents_in_the_package_stand_in_for_those_of_the_repository(monkeypatch, tmp_path):
    folder = tmp_path / "packaged"
    monkeypatch.setattr(adapters, "pretrained_folder", lambda env_id, algo: folder if algo == "ppo" else None)
    monkeypatch.setattr(adapters, "SAVED", tmp_path / "nothing")
    assert adapters.saved_agent("ppo", ID) == folder
    with pytest.raises(InputError, match="'dqn', of which none is saved"):
        adapters.saved_agent("dqn", ID)


@pytest.fixture(scope="module")
def models():
    from stable_baselines3 import DQN, PPO

    envs = SB3VecEnv(ID, num_envs=8, reward="relative", horizon=4)
    return {
        "ppo": PPO("MlpPolicy", envs, n_steps=8, batch_size=32, gamma=0.9, seed=0).learn(128),
        "dqn": DQN("MlpPolicy", envs, learning_starts=32, buffer_size=500, seed=0).learn(128),
    }


@pytest.mark.parametrize(("algo", "jobs"), [("ppo", 1), ("dqn", 1), pytest.param("ppo", 2, marks=pytest.mark.slow)])
def test_a_model_of_stable_baselines3_is_compared_in_one_call(models, algo, jobs, tmp_path):
    model = models[algo]
    model.save(tmp_path / "trained")
    given = {"model": model, "network": model.policy, "saved": tmp_path / "trained.zip"}
    comparison = compare(ID, given, worlds=60, jobs=jobs, horizon=4, trust=True)
    by_hand = play(TASK, as_policy(lambda o: model.predict(o, deterministic=True)[0]), world_seeds(0, "test", 50))
    for name in given:
        np.testing.assert_array_equal(comparison.cost(name)[0, :50], by_hand.episode_cost())
    assert comparison.cost("myopic").shape == (1, 60)


def test_a_masked_model_of_sb3_contrib_is_saved_and_loaded(models, tmp_path):
    contrib = pytest.importorskip("sb3_contrib")
    envs = SB3VecEnv(ID, num_envs=2, horizon=4)
    model = contrib.MaskablePPO("MlpPolicy", envs, n_steps=4, batch_size=8, seed=0)
    model.save(tmp_path / "masked")
    same_play(as_policy(model), as_policy(tmp_path / "masked.zip", TASK, trust=True))
    assert "action_masks" in adapters.PredictPolicy(model)._taken


def test_a_folder_of_ours_is_an_agent(monkeypatch):
    folder = adapters.saved_agent("ppo", ID) / "seed0"
    task = make_task(ID, {})
    same_play(as_policy(folder, task), as_policy(str(folder), task), task)


def test_the_name_of_a_saved_agent_is_its_first_training_run():
    env_id = "wavegym/KershawEvansPosition-v0"
    named = as_policy("ppo", env_id)
    first = as_policy(Path(__file__).parents[2] / "results" / "runs" / "KershawEvansPosition" / "ppo" / "seed0", env_id)
    found = compare(env_id, {"named": named, "first": first}, worlds=3, jobs=1, progress=False)
    np.testing.assert_array_equal(found.cost("named"), found.cost("first"))


class _OfFields:
    """A model with an observation space of so many fields, which remembers how many steps it has seen."""

    def __init__(self, fields):
        self.observation_space = spaces.Box(-10.0, 10.0, (fields,), np.float32)
        self.seen = []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        steps = np.where(episode_start, 0, 0 if state is None else state) + 1
        self.seen.append((observation.shape, steps))
        return np.zeros(len(observation), np.int64), steps


def test_a_model_of_measurements_plays_where_they_are_observed():
    measured = gym.make("wavegym/KershawEvans-v0", observation="measurements").observation_space.shape[0]
    model = _OfFields(measured)
    compare("KershawEvans-v0", {"mine": model}, worlds=3, jobs=1, horizon=4, observation="measurements")
    assert {shape for shape, _ in model.seen} <= {(1, measured), (3, measured)}
    np.testing.assert_array_equal(model.seen[-1][1], [4, 4, 4])
    with pytest.raises(InputError, match="observation='measurements'"):
        compare("KershawEvans-v0", {"mine": _OfFields(measured)}, worlds=3, jobs=1, horizon=4)


def test_a_model_of_beliefs_plays_where_measurements_are_observed():
    own = gym.make("wavegym/KershawEvans-v0").observation_space.shape[0]
    model = _OfFields(own)
    compare("KershawEvans-v0", {"mine": model}, worlds=3, jobs=1, horizon=4, observation="measurements")
    assert {shape[1] for shape, _ in model.seen} == {own}
