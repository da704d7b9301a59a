"""PPO with a network for each agent, and with one network for all agents, against one network for the whole action.

    python examples/several_agents/train.py RfEoFar-v0 --sees own all --out out/several_agents/RfEoFar

trains and compares with the schedulers on the same test worlds:

* joint: one network sees the whole observation and chooses the whole action;
* shared: one network plays every agent; the agent's number, one-hot, is the end of its input;
* independent: every agent has a network of its own, trained on its own steps in the same worlds.

All have the same settings of PPO and the same number of environment steps. A minibatch is a quarter of a network's
samples of a rollout, so every network makes the same number of gradient steps. Models in ``--out`` are not trained
again.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from wavegym.envs.sb3 import SB3VecEnv
from wavegym.evaluation import compare, full_id, training_seeds, write_report
from wavegym.integrations.pettingzoo import BatchedParallelEnv, TeamPolicy

# The reward of the training, and the system's settings. "relative" and "log-cost" remove the difficulty of a world.
TASKS: dict[str, tuple[str, dict[str, Any]]] = {
    "AgileClutter-v0": ("relative", {"tracker": "mixture"}),
    "RfEoFar-v0": ("log-cost", {"action": "library", "points": (8, 1, 8)}),
}
STEPS = {"AgileClutter-v0": 102_400, "RfEoFar-v0": 102_400}  # of the environments, a few minutes each
SHARES = 4  # minibatches of a rollout
LEARNING_RATE = 1e-3  # falls linearly to 0
SETTINGS = {"n_steps": 32, "n_epochs": 10, "gamma": 0.9, "gae_lambda": 0.9, "policy_kwargs": {"net_arch": [64, 64]}}


def make_ppo(env: VecEnv, seed: int) -> PPO:
    """An untrained network and its PPO."""
    batch = env.num_envs * SETTINGS["n_steps"] // SHARES
    rate = lambda left: LEARNING_RATE * max(left, 0.0)  # noqa: E731
    return PPO("MlpPolicy", env, learning_rate=rate, batch_size=batch, seed=seed, device="cpu", **SETTINGS)


class AgentRows(VecEnv):
    """Every agent of every environment as a separate row, so that one network learns from all.

    Rows: all environments of the first agent, then of the second. A row is the agent's observation and its number.

    Args:
        envs: with ``autoreset_mode="SameStep"``.
        seeds: of the worlds, for the first reset.

    Raises:
        ValueError: the agents' spaces differ, so that one network cannot play all.
    """

    def __init__(self, envs: BatchedParallelEnv, seeds: Sequence[int]) -> None:
        self.envs, self.names, self._first = envs, envs.possible_agents, list(seeds)
        if len({str(space) for space in envs.action_spaces.values()}) > 1:
            raise ValueError(f"action spaces are {envs.action_spaces}, expected the same for every agent")
        sizes = {space.shape[0] for space in envs.observation_spaces.values()}
        if len(sizes) > 1:
            raise ValueError(f"observation spaces are {envs.observation_spaces}, expected the same for every agent")
        space = spaces.Box(-10.0, 10.0, (sizes.pop() + len(self.names),), np.float32)
        super().__init__(envs.num_envs * len(self.names), space, envs.action_spaces[self.names[0]])

    def reset(self) -> np.ndarray:
        """The first observations, (row, fields)."""
        observations, _ = self.envs.reset(seed=self._first)
        return self._rows(observations)

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions (row, ...) for ``step_wait``."""
        self._actions = dict(zip(self.names, np.split(actions, len(self.names)), strict=True))

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """One step of every environment, as Stable-Baselines3 expects it."""
        observations, rewards, ends, cuts, infos = self.envs.step(self._actions)
        rows: list[dict[str, Any]] = []
        for number, name in enumerate(self.names):
            late = cuts[name] & ~ends[name]
            rows += [{"TimeLimit.truncated": bool(each)} for each in late]
            for row in np.flatnonzero(ends[name] | cuts[name]):
                last = infos[name]["final_obs"][row][None]
                rows[number * self.envs.num_envs + row]["terminal_observation"] = numbered(last, number, self.names)[0]
        over = np.concatenate([ends[name] | cuts[name] for name in self.names])
        gained = np.concatenate([rewards[name] for name in self.names]).astype(np.float32)
        return self._rows(observations), gained, over, rows

    def _rows(self, observations: dict[str, np.ndarray]) -> np.ndarray:
        parts = [numbered(observations[name], number, self.names) for number, name in enumerate(self.names)]
        return np.concatenate(parts)

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The only attribute is the render mode, which is None."""
        if attr_name != "render_mode":
            raise AttributeError(attr_name)
        return [None] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Rows have no attributes."""
        raise AttributeError(attr_name)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Rows have no methods."""
        raise AttributeError(method_name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No row is wrapped."""
        return [False] * self.num_envs


def numbered(observation: np.ndarray, number: int, names: Sequence[str]) -> np.ndarray:
    """Observations (env, fields) of the agent of this number, with the number one-hot at the end."""
    hot = np.zeros((len(observation), len(names)), np.float32)
    hot[:, number] = 1.0
    return np.concatenate([observation, hot], axis=1)


class Seat(gym.Env):
    """The spaces of one agent, for a PPO that ``train_independent`` steps."""

    def __init__(self, observation_space: spaces.Space, action_space: spaces.Space) -> None:
        self.observation_space, self.action_space = observation_space, action_space


def train_independent(envs: BatchedParallelEnv, seeds: Sequence[int], seed: int, steps: int) -> dict[str, PPO]:
    """One PPO for each agent: all act in the same environments, and each learns from its own observations."""
    models = {}
    for number, name in enumerate(envs.possible_agents):
        own = envs.observation_spaces[name], envs.action_spaces[name]
        seats = DummyVecEnv([lambda own=own: Seat(*own)] * envs.num_envs)
        models[name] = make_ppo(seats, seed * len(envs.possible_agents) + number)
        models[name].set_logger(configure(None, []))
    set_random_seed(seed)  # otherwise the last model's seed would be that of all sampling
    observations, _ = envs.reset(seed=list(seeds))
    starts = np.ones(envs.num_envs, np.bool_)
    rollout, done = envs.num_envs * SETTINGS["n_steps"], 0
    while done < steps:
        observations, starts = collect(models, envs, observations, starts)
        done += rollout
        for model in models.values():
            model.lr_schedule = lambda _, left=1.0 - done / steps: LEARNING_RATE * max(left, 0.0)
            model.train()
    return models


@torch.no_grad()
def collect(
    models: dict[str, PPO], envs: BatchedParallelEnv, observations: dict[str, np.ndarray], starts: np.ndarray
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Fill the rollout buffer of every agent; returns the next observations, and which of them begin an episode."""
    for model in models.values():
        model.policy.set_training_mode(False)
        model.rollout_buffer.reset()
    for _ in range(SETTINGS["n_steps"]):
        played = {name: model.policy(torch.as_tensor(observations[name])) for name, model in models.items()}
        actions = {name: chosen.numpy() for name, (chosen, _, _) in played.items()}
        following, rewards, ends, cuts, infos = envs.step(actions)
        for name, model in models.items():
            reward = rewards[name].astype(np.float32)
            late = np.flatnonzero(cuts[name] & ~ends[name])
            if len(late):  # the episode goes on past its truncation
                last = torch.as_tensor(np.stack(list(infos[name]["final_obs"][late])))
                reward[late] += model.gamma * model.policy.predict_values(last).numpy()[:, 0]
            chosen = actions[name].reshape(envs.num_envs, -1)
            model.rollout_buffer.add(observations[name], chosen, reward, starts, *played[name][1:])
        observations, name = following, envs.possible_agents[0]
        starts = ends[name] | cuts[name]
    for name, model in models.items():
        values = model.policy.predict_values(torch.as_tensor(observations[name]))
        model.rollout_buffer.compute_returns_and_advantage(values, starts)
    return observations, starts


class Numbered:
    """The shared network as the policy of one agent."""

    def __init__(self, model: PPO, number: int, names: Sequence[str]) -> None:
        self.policy, self.number, self.names = model.policy, number, tuple(names)

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Deterministic actions (env, ...) of the agent's observations (env, fields)."""
        actions, _ = self.policy.predict(numbered(observation, self.number, self.names), deterministic=True)
        return actions


def trained(env: str, kind: str, sees: str, seed: int, steps: int, num_envs: int, folder: Path) -> dict[str, PPO]:
    """The networks of one learner by name, trained or read from ``folder``."""
    files = {path.stem: path for path in folder.glob("*.zip")}
    if files:
        return {name: PPO.load(path, device="cpu") for name, path in files.items()}
    reward, settings = TASKS[env]
    seeds, began = training_seeds(0, seed, num_envs), perf_counter()
    if kind == "joint":
        joint = SB3VecEnv(full_id(env), num_envs, reward=reward, **settings)
        models = {"joint": make_ppo(joint, seed)}  # seeds the environments too
        joint.seed(seeds)
        models["joint"].learn(steps)
    else:
        envs = BatchedParallelEnv(env, num_envs, sees=sees, autoreset_mode="SameStep", reward=reward, **settings)
        if kind == "shared":
            models = {"shared": make_ppo(AgentRows(envs, seeds), seed)}
            models["shared"].learn(steps * len(envs.possible_agents))
        else:
            models = train_independent(envs, seeds, seed, steps)
    folder.mkdir(parents=True, exist_ok=True)
    for name, model in models.items():
        model.save(folder / name)
    print(f"{kind} {sees} {seed}: {steps} steps in {perf_counter() - began:.0f} s", flush=True)
    return models


def as_team(models: dict[str, PPO], kind: str, sees: str, agents: Sequence[str]) -> Any:
    """What ``compare`` plays."""
    if kind == "joint":
        return models["joint"]
    if kind == "shared":
        return TeamPolicy({name: Numbered(models["shared"], k, agents) for k, name in enumerate(agents)}, sees=sees)
    return TeamPolicy(models, sees=sees)


def run(env: str, sees: Sequence[str], seeds: Sequence[int], steps: int, num_envs: int, worlds: int, out: Path) -> str:
    """Train all learners, compare them on the same worlds, and write a report; returns its table."""
    agents = BatchedParallelEnv(env, **TASKS[env][1]).possible_agents
    learners = [("joint", "all"), *((kind, each) for each in sees for kind in ("shared", "independent"))]
    policies: dict[str, Any] = {"random": None}
    for kind, view in learners:
        name = kind if kind == "joint" else f"{kind}, sees {view}"
        folders = [out / f"{kind}-{view}-{seed}" for seed in seeds]
        policies[name] = [
            as_team(trained(env, kind, view, seed, steps, num_envs, folder), kind, view, agents)
            for seed, folder in zip(seeds, folders, strict=True)
        ]
    return write_report(compare(env, policies, worlds=worlds, jobs=1, **TASKS[env][1]), out / "report")


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("env", choices=TASKS)
    parser.add_argument("--sees", nargs="+", choices=("own", "all"), default=["own"], help="what each agent observes")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1], help="of the training runs")
    parser.add_argument("--steps", type=int, help="of the environments, in one training run")
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--worlds", type=int, default=200, help="test worlds")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    steps = given.steps or STEPS[given.env]
    print(run(given.env, given.sees, given.seeds, steps, given.num_envs, given.worlds, given.out))


if __name__ == "__main__":
    main()
