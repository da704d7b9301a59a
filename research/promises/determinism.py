"""The same episodes in every way of playing: ``python -m research.promises.determinism [ENVIRONMENT ...]``.

Each environment plays eight episodes with the best heuristic and PPO: in one batch, one by one, in threads, in smaller
batches of other processes, and on a Ray cluster if Ray is installed. Observations, rewards and flags of all steps must
be the same, byte for byte; otherwise the command fails. Random actions are drawn for a whole batch, so they would
differ between batches of different size.
"""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any

import gymnasium as gym
import joblib
import numpy as np
from tqdm import tqdm

import wavegym
from agents.leaderboard import environment_of
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError
from wavegym.core.work import Call, cluster, run_all
from wavegym.evaluation.adapters import SAVED
from wavegym.registration import SYSTEMS, full_id, stem
from wavegym.schedulers.tuned_constants import SIMPLE

SEEDS, STEPS, HALF = tuple(range(100, 108)), 40, 4
PPO = "ppo"
POLICIES = (SIMPLE, PPO)


def batch(env_id: str, policy: str, seeds: Sequence[int], threads: int = 1) -> list[str]:
    """A digest of each episode, at most ``STEPS`` steps, played in one batch."""
    agent, parameters = _player(env_id, policy)
    envs: Any = gym.make_vec(env_id, num_envs=len(seeds), num_threads=threads, **parameters)
    return _played(envs, agent, list(seeds))


def single(env_id: str, policy: str, seeds: Sequence[int]) -> list[str]:
    """As ``batch``, one environment after the other."""
    agent, parameters = _player(env_id, policy)
    found = []
    for seed in seeds:
        found += _played(gym.make(env_id, disable_env_checker=True, **parameters), agent, seed)
    return found


def _player(env_id: str, policy: str) -> tuple[Any, dict[str, Any]]:
    """A policy and the parameters of its environment."""
    if policy != PPO:
        return policy, {}
    parameters = environment_of(SAVED / stem(env_id) / PPO)
    return wavegym.load_agent(env_id, PPO, **parameters), parameters


def _played(env: Any, policy: Any, seed: Any) -> list[str]:
    """Digests of the episodes of an environment or a batch of them."""
    several = isinstance(seed, list)

    def rows(values: Any) -> list[Any]:
        return list(values) if several else [np.asarray(values)]

    observation, _ = env.reset(seed=seed)
    decide = env.unwrapped.policy(policy)
    digests = [hashlib.sha256(row.tobytes()) for row in rows(observation)]
    running = [True] * len(digests)
    for _ in range(STEPS):
        observation, reward, terminated, truncated, _ = env.step(decide())
        lines = zip(*map(rows, (observation, reward, terminated, truncated)), strict=True)
        for i, (row, gain, ends, stops) in enumerate(lines):
            if running[i]:
                digests[i].update(row.tobytes() + float(gain).hex().encode() + bytes([bool(ends), bool(stops)]))
                running[i] = not (ends or stops)
        if not any(running):
            break
    env.close()
    return [digest.hexdigest() for digest in digests]


def elsewhere(env_id: str, policy: str) -> list[str]:
    """As ``batch``, in two batches of half the size in other processes, or on the cluster that joblib is set to."""
    calls = [Call(batch, (env_id, policy, SEEDS[i : i + HALF])) for i in range(0, len(SEEDS), HALF)]
    return [digest for part in run_all(calls, jobs=2) for digest in part]


def on_ray(env_id: str, policy: str) -> list[str]:
    """As ``elsewhere``, on the Ray cluster that ``main`` has started."""
    with joblib.parallel_config("ray"):
        return elsewhere(env_id, policy)


WAYS: dict[str, Callable[[str, str], list[str]]] = {
    "one by one": lambda env_id, policy: single(env_id, policy, SEEDS),
    "in three threads": lambda env_id, policy: batch(env_id, policy, SEEDS, threads=3),
    "in two processes": elsewhere,
    "on Ray": on_ray,
}


def differing(env_id: str, policy: str, ways: Sequence[str]) -> list[str]:
    """The ways in which the episodes are not those of one batch, with environment and policy."""
    wanted = batch(env_id, policy, SEEDS)
    return [f"{stem(env_id)} under {policy} {way}" for way in ways if WAYS[way](env_id, policy) != wanted]


def policies_of(env_id: str) -> Sequence[str]:
    """The policies under which an environment is played.

    Without an agent, only a round robin: other heuristics first try waveforms, which takes hours in UrbanSignal.
    """
    return POLICIES if (SAVED / stem(env_id) / PPO).exists() else ("round-robin",)


def main() -> None:
    """The command."""
    parser = Parser(
        prog="python -m research.promises.determinism", description="Are episodes the same in every way of playing?"
    )
    parser.add_argument("ids", nargs="*", metavar="ENVIRONMENT", help="which to play (default: all of the suite)")
    ids = [full_id(name) for name in parser.read(None).ids] or list(SYSTEMS)
    has_ray = importlib.util.find_spec("ray") is not None
    ways = [way for way in WAYS if has_ray or way != "on Ray"]
    pairs = [(env_id, policy) for env_id in ids for policy in policies_of(env_id)]
    with cluster() if has_ray else nullcontext():
        found = [differing(env_id, policy, ways) for env_id, policy in tqdm(pairs, unit="policy", disable=None)]
    wrong, count = [each for one in found for each in one], len(pairs) * len(ways)
    print(f"{count - len(wrong)} of {count} comparisons with one batch ({', '.join(ways)}): the same bytes")
    if wrong:
        raise InputError(f"other bytes: {'; '.join(wrong)}")


if __name__ == "__main__":
    sys.exit(guarded(main))
