"""The example of several agents: its training loop against Stable-Baselines3's own, a short run, and the page."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import torch
from test_docs_how_to import run
from two_sensors import TwoSensors

from wavegym.core.system import System
from wavegym.envs.sb3 import SB3VecEnv
from wavegym.envs.vector import WaveformVectorEnv
from wavegym.integrations.pettingzoo import BatchedParallelEnv

SCRIPT = Path(__file__).parents[1] / "examples" / "several_agents" / "train.py"
STEPS = 6 * 32 * 4


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("several_agents_example", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class TeamOfOne:
    """A vector environment in the form of a batch of parallel environments with a single agent."""

    possible_agents = ["alone"]

    def __init__(self, system: System, num_envs: int, **settings) -> None:
        self.batch, self.num_envs = WaveformVectorEnv(system, num_envs, **settings), num_envs
        self.observation_spaces = {"alone": self.batch.single_observation_space}
        self.action_spaces = {"alone": self.batch.single_action_space}

    def reset(self, seed):
        return tuple({"alone": each} for each in self.batch.reset(seed=seed))

    def step(self, actions):
        return tuple({"alone": each} for each in self.batch.step(actions["alone"]))


@pytest.mark.slow
@pytest.mark.parametrize("settings", [{}, {"max_episode_steps": 5}])
def test_an_independent_learner_without_others_is_stable_baselines3s_ppo(example, monkeypatch, settings):
    """The same samples, the same bootstrap at truncations and the same gradient steps: equal networks, bit for bit."""
    settings = {**settings, "autoreset_mode": "SameStep"}
    seeds = list(range(6))
    envs = SB3VecEnv(lambda **given: WaveformVectorEnv(TwoSensors(), **given), 6, max_episode_steps=5)
    if "max_episode_steps" not in settings:
        envs = SB3VecEnv(lambda **given: WaveformVectorEnv(TwoSensors(), **given), 6)
    wanted = example.make_ppo(envs, 1)
    envs.seed(seeds)
    wanted.learn(STEPS)
    monkeypatch.setattr(example, "set_random_seed", lambda seed: None)  # the model's own seed is the only one here
    found = example.train_independent(TeamOfOne(TwoSensors(), 6, **settings), seeds, 1, STEPS)["alone"]
    for name, weights in wanted.policy.state_dict().items():
        assert torch.equal(found.policy.state_dict()[name], weights), name


def test_rows_of_agents_are_the_batchs_values(example):
    """Each agent's rows, its number at the end of its observations, and what Stable-Baselines3 needs at an end."""
    envs, twin = (BatchedParallelEnv(TwoSensors(), 2, autoreset_mode="SameStep", max_episode_steps=3) for _ in range(2))
    rows, (first, _) = example.AgentRows(envs, [4, 5]), twin.reset(seed=[4, 5])
    got = rows.reset()
    for _ in range(3):
        np.testing.assert_array_equal(got[:2, :-2], first["sensor_1"])
        np.testing.assert_array_equal(got[2:, :-2], first["sensor_2"])
        assert got[:, -2:].tolist() == [[1, 0], [1, 0], [0, 1], [0, 1]]
        got, rewards, over, infos = rows.step(np.array([0, 1, 2, 0]))
        first, reward, _, _, info = twin.step({"sensor_1": np.array([0, 1]), "sensor_2": np.array([2, 0])})
        np.testing.assert_array_equal(rewards, np.tile(reward["sensor_1"], 2).astype(np.float32))
    assert over.all()
    assert all(row["TimeLimit.truncated"] for row in infos)
    np.testing.assert_array_equal(infos[3]["terminal_observation"][:-2], info["sensor_2"]["final_obs"][1])
    assert infos[3]["terminal_observation"][-2:].tolist() == [0, 1]


@pytest.mark.slow
@pytest.mark.parametrize("env", ["RfEoFar-v0", "AgileClutter-v0"])
def test_a_short_run_compares_all_learners(example, env, tmp_path, capsys):
    arguments = [env, "--steps", "1024", "--num-envs", "8", "--seeds", "0", "--worlds", "3", "--out", str(tmp_path)]
    example.main([*arguments, "--sees", "own", "all"])
    first = capsys.readouterr().out
    for learner in ("joint", "shared, sees own", "independent, sees own", "shared, sees all", "independent, sees all"):
        assert f"| {learner} " in first
    assert first.count("1024 steps in") == 5
    example.main([*arguments, "--sees", "own", "all"])  # saved models are read, and play alike
    again = capsys.readouterr().out
    assert "steps in" not in again
    costs = [[line.split("|")[2] for line in text.splitlines() if line.startswith("| ")] for text in (first, again)]
    assert costs[0] == costs[1]


def test_the_page_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run("how_to/several_agents.md", {})
    assert "one for each sensor" in capsys.readouterr().out
