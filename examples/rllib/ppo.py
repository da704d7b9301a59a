"""PPO of RLlib on a Ray cluster of this machine, then the trained policy against the schedulers on test worlds.

    python examples/rllib/ppo.py KershawEvansPosition-v0 --steps 320000
    python examples/rllib/ppo.py EnergyBudgetKnown-v0 --masks --steps 320000

On a cluster of several machines use --address auto on its head node, and one worker for each free core.
"""

from __future__ import annotations

import argparse
from time import perf_counter
from typing import Any

import numpy as np
import torch
from gymnasium import VectorizeMode
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.core.rl_module.rl_module import RLModule, RLModuleSpec
from ray.rllib.examples.rl_modules.classes.action_masking_rlm import ActionMaskingTorchRLModule

from wavegym.evaluation import compare, full_id, summarise
from wavegym.integrations.ray import cluster, register_envs
from wavegym.learning.settings import load_settings


class LikeliestAction:
    """The likeliest action of an RLModule; ``compare`` takes an object with ``predict``."""

    def __init__(self, module: RLModule) -> None:
        self.module = module

    def predict(self, observation: np.ndarray, action_masks: np.ndarray | None = None, **_: Any) -> np.ndarray:
        """Actions (env,) for observations (env, fields); ``action_masks`` (env, actions) if the actions have masks."""
        seen: Any = torch.as_tensor(observation)
        if isinstance(self.module, ActionMaskingTorchRLModule):
            seen = {"observations": seen, "action_mask": torch.as_tensor(action_masks, dtype=torch.float32)}
        with torch.no_grad():
            logits = self.module.forward_inference({Columns.OBS: seen})[Columns.ACTION_DIST_INPUTS]
        return logits.argmax(dim=-1).numpy()


def config(env_id: str, masks: bool, workers: int, envs: int, seed: int) -> PPOConfig:
    """The suite's settings for PPO in this environment, and native batches, without imitation."""
    own = load_settings(env_id, "ppo")
    batch = workers * envs * own.n_steps
    network = DefaultModelConfig(fcnet_hiddens=list(own.network), fcnet_activation=own.activation)
    module = RLModuleSpec(module_class=ActionMaskingTorchRLModule if masks else None, model_config=network)
    return (
        PPOConfig()
        .environment(env_id, env_config={"reward": own.reward, "masks": masks, **dict(own.environment)})
        .env_runners(
            num_env_runners=workers,
            num_envs_per_env_runner=envs,
            gym_env_vectorize_mode=VectorizeMode.VECTOR_ENTRY_POINT,
            rollout_fragment_length=own.n_steps,
        )
        .rl_module(rl_module_spec=module)
        .training(
            gamma=own.gamma,
            lambda_=own.gae_lambda,
            lr=own.learning_rate,
            train_batch_size=batch,
            minibatch_size=batch // 4,
            num_epochs=own.n_epochs,
            clip_param=own.clip_range,
            entropy_coeff=own.ent_coef,
            vf_clip_param=float("inf"),
        )
        .debugging(seed=seed)
    )


def train(env_id: str, masks: bool, steps: int, workers: int, envs: int, seed: int) -> LikeliestAction:
    """The trained policy."""
    settings = config(env_id, masks, workers, envs, seed)
    algorithm = settings.build_algo()
    for _ in range(max(steps // settings.train_batch_size, 1)):
        algorithm.train()
    policy = LikeliestAction(algorithm.get_module())
    algorithm.stop()
    return policy


def main() -> None:
    """Read the options, train, compare, print."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("env")
    options.add_argument("--masks", action="store_true", help="forbidden actions get probability 0")
    options.add_argument("--steps", type=int, default=320_000)
    options.add_argument("--workers", type=int, default=2)
    options.add_argument("--envs", type=int, default=32, help="environments of each worker")
    options.add_argument("--worlds", type=int, default=200)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--address", help="of the Ray cluster (default: one started on this machine)")
    given = options.parse_args()
    env_id = full_id(given.env)
    with cluster(given.address):
        register_envs()
        start = perf_counter()
        policy = train(env_id, given.masks, given.steps, given.workers, given.envs, given.seed)
        seconds = perf_counter() - start
    summary = summarise(compare(env_id, {"rllib": policy}, worlds=given.worlds, jobs=1))
    cost = {name: entry["cost"]["mean"] for name, entry in summary["policies"].items()}
    percent = 100.0 * (cost["rllib"] / cost["myopic"] - 1.0)
    print(f"{env_id}: {percent:+.1f} % of the cost of myopic after {given.steps} steps in {seconds:.0f} s")


if __name__ == "__main__":
    main()
