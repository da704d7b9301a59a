"""The trained agents that come with the package."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import wavegym
from agents.package import move, sources
from wavegym.core.errors import InputError, InputWarning
from wavegym.core.policy import Policy
from wavegym.policies.runs import PRETRAINED, PRETRAINED_FILES, RUN, pretrained_folder, read_run, shown_in

PACKAGED = [(run["env"], run["algo"]) for run in map(read_run, sorted(PRETRAINED.glob(f"*/*/{RUN}")))]


def test_they_are_seed_0_of_every_run_in_the_results() -> None:
    copied = {file for folder in sources() for file in (folder / name for name in PRETRAINED_FILES)}
    assert {file for file in PRETRAINED.glob("*/*/*") if file.suffix not in (".py", ".pyc")} == copied
    assert len(copied) == 2 * len(PACKAGED) == 54
    for packaged, run in sources().items():
        assert read_run(packaged / RUN)["seed"] == 0
        assert (run.is_symlink(), run.resolve()) == (True, packaged.resolve())


def test_a_new_agent_is_moved_and_linked(tmp_path: Path) -> None:
    run, packaged = tmp_path / "runs" / "ppo" / "seed0", tmp_path / "pretrained" / "ppo"
    run.mkdir(parents=True)
    for name in (*PRETRAINED_FILES, "curve.csv"):
        (run / name).write_text(name)
    move(run, packaged)
    assert run.resolve() == packaged.resolve()
    assert {file.name: file.read_text() for file in run.iterdir()} == {name: name for name in PRETRAINED_FILES}


@pytest.mark.parametrize(("env_id", "algo"), PACKAGED)
def test_each_is_loaded_with_the_parameters_of_its_training(env_id: str, algo: str) -> None:
    folder = pretrained_folder(env_id, algo)
    assert folder is not None
    policy = wavegym.load_agent(env_id, algo, **read_run(folder / RUN)["settings"]["environment"])
    assert isinstance(policy, Policy)


def test_an_agent_plays_a_vector_environment() -> None:
    agent = wavegym.load_agent("SectorSetup-v0", "ppo")
    envs = gym.make_vec("wavegym/SectorSetup-v0", num_envs=3, forecasts=True)
    observations, _ = envs.reset(seed=0)
    assert envs.action_space.contains(agent.act(None, observations, None))


def test_the_folder_of_a_run_is_an_agent_too_and_one_of_ranks_plays_without_a_list() -> None:
    folder = pretrained_folder("wavegym/RfEoFar-v0", "ppo")
    envs: Any = gym.make_vec("wavegym/RfEoFar-v0", num_envs=3)
    observations, _ = envs.reset(seed=0)
    actions = []
    for given in ("ppo", str(folder)):
        agent = wavegym.load_agent("RfEoFar-v0", given)
        agent.begin(envs.unwrapped.system, 3, np.random.default_rng(0))
        actions.append(agent.act(envs.unwrapped.belief, observations, None))
    assert envs.action_space.contains(actions[0].astype(np.float32))
    np.testing.assert_array_equal(*actions)


@pytest.mark.parametrize("parameters", [{}, {"slots": 20}, {"targets": 12.0}, {"acceleration": (8.0, 100.0)}], ids=str)
def test_an_agent_of_several_variants_is_at_home_in_all(parameters: dict, recwarn: pytest.WarningsRecorder) -> None:
    wavegym.load_agent("MultifunctionRadar-v1", "ppo", **parameters)
    assert not recwarn.list


def test_where_an_agent_of_several_variants_was_not_it_says_so() -> None:
    with pytest.warns(InputWarning, match=r"parameters that differ: beam_width=3.0 \(training: 1.5\)$"):
        wavegym.load_agent("MultifunctionRadar-v1", "ppo", beam_width=3.0)


@pytest.mark.parametrize(
    ("env_id", "algo", "parameters", "message"),
    [
        ("Urbann-v0", "ppo", {}, "did you mean 'wavegym/Urban-v0'?"),
        ("UrbanSignal-v0", "ppo", {}, "comes without a trained agent, .*did you mean 'wavegym/Urban-v0'?"),
        ("Urban-v0", "po", {}, "agent is 'po', expected one of 'ppo', 'dqn'; did you mean 'ppo'?"),
        ("Urban-v0", "ppo", {"horizont": 3}, "did you mean 'horizon'?"),
        ("AgileClutter-v0", "dqn", {"action": "library"}, "nearest: the setting action=joint of its training"),
    ],
)
def test_a_mistake_names_the_nearest_agent(env_id: str, algo: str, parameters: dict, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        wavegym.load_agent(env_id, algo, **parameters)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("env_id", ["own/Urban-v0", "wavegym/Urban-v1", "wavegym/Nowhere-v0"])
def test_an_environment_of_another_name_has_none(env_id: str) -> None:
    assert pretrained_folder(env_id, "ppo") is None
    assert pretrained_folder("wavegym/Urban-v0", "../Urban/ppo") is None


@pytest.mark.parametrize(
    ("settings", "shown"),
    [
        ({}, (False, None)),
        ({"forecasts": True, "candidates": 0}, (True, None)),
        ({"forecasts": False, "candidates": 32}, (False, 32)),
    ],
)
def test_a_run_without_a_short_list_shows_all_actions(settings: dict, shown: tuple) -> None:
    """``candidates`` is 0 in such a run, and absent in runs older than the setting."""
    assert shown_in({"settings": settings}) == shown
