"""From a training run to an untrained Stable-Baselines3 model with its environments."""

from __future__ import annotations

import dataclasses
import io
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from sb3_contrib import MaskablePPO
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from wavegym.core.errors import InputError
from wavegym.core.system import System
from wavegym.core.traits import UnequalSteps
from wavegym.envs.sb3 import BatchedVecEnv, SB3MixedVecEnv, SB3VecEnv
from wavegym.evaluation import training_seeds
from wavegym.learning.mixture import MixturePolicy
from wavegym.learning.scorer import Layout, MaskableScorerPolicy, ScorerDQNPolicy, ScorerPolicy
from wavegym.learning.settings import PPOSettings, Settings
from wavegym.learning.time_discount import TimedMaskableRolloutBuffer, TimedRolloutBuffer
from wavegym.learning.training_run import TrainingRun
from wavegym.policies.runs import difference, signature

BASE_SEED = 0  # of training worlds; test worlds differ from them for every seed
ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}
# Settings that Stable-Baselines3 does not know.
OURS = (
    *("steps", "num_envs", "reward", "forecasts", "candidates", "policy", "network", "activation", "learning_rate"),
    *("environment", "variants"),
    *(
        "masks",
        "discount",
        "modes",
        "teacher",
        "teacher_futures",
        "teacher_episodes",
        "imitation_rounds",
        "query_every",
        "imitation_epochs",
        "critic_warm_up",
    ),
)
POLICIES = {PPO: ScorerPolicy, MaskablePPO: MaskableScorerPolicy, DQN: ScorerDQNPolicy}


def model_class(settings: Settings) -> type[BaseAlgorithm]:
    """The algorithm of these settings."""
    if not isinstance(settings, PPOSettings):
        return DQN
    return MaskablePPO if settings.masks else PPO


def build_model(run: TrainingRun) -> BaseAlgorithm:
    """The untrained model; every random generator is seeded.

    Raises:
        InputError: a setting unknown to the environment, or actions that the algorithm cannot choose.
    """
    settings, algorithm = run.settings, model_class(run.settings)
    env = _environments(run, settings.num_envs // max(len(settings.variants), 1))
    own = {f.name: getattr(settings, f.name) for f in dataclasses.fields(settings) if f.name not in OURS}
    if algorithm is DQN:
        own["train_freq"] = 1
    if discounts_seconds(settings):
        # With gamma = 1 Stable-Baselines3 takes the value at a time limit as it is; the buffer has the factors.
        buffer = TimedMaskableRolloutBuffer if algorithm is MaskablePPO else TimedRolloutBuffer
        own |= {
            "gamma": 1.0,
            "rollout_buffer_class": buffer,
            "rollout_buffer_kwargs": {"gamma_per_second": settings.gamma},
        }
    policy, network = _network(settings, env)
    model = algorithm(
        policy,
        env,
        learning_rate=LinearSchedule(settings.learning_rate, 0.0, 1.0),
        policy_kwargs=network,
        seed=run.seed,
        device="cpu",
        **own,
    )
    env.seed(training_seeds(BASE_SEED, run.seed, settings.num_envs))
    return model


def discounts_seconds(settings: Settings) -> bool:
    """Whether gamma is a factor per second."""
    return isinstance(settings, PPOSettings) and settings.discount == "second"


def _network(settings: Settings, env: BatchedVecEnv) -> tuple[Any, dict[str, Any]]:
    """Stable-Baselines3's policy and its keyword arguments."""
    network = {"net_arch": list(settings.network), "activation_fn": ACTIVATIONS[settings.activation]}
    if settings.policy == "scorer":
        system = env.get_attr("system", 0)[0]
        network["layout"] = tuple(Layout.of(env.observation_space, env.action_space, system))  # type: ignore[arg-type]
        return POLICIES[model_class(settings)], network
    if _modes(settings) > 1:
        return MixturePolicy, {**network, "modes": _modes(settings)}
    return "MlpPolicy", network


def _modes(settings: Settings) -> int:
    return settings.modes if isinstance(settings, PPOSettings) else 1


def systems_of(env: VecEnv) -> list[System]:
    """The systems of a run's environments, one for each variant."""
    return list({id(system): system for system in env.get_attr("system")}.values())


def _environments(run: TrainingRun, count: int) -> BatchedVecEnv:
    """``count`` of the run's environments of each variant.

    Raises:
        InputError: the algorithm or the policy cannot choose their actions; variants whose observations or actions
            differ in their meaning.
    """
    settings = run.settings
    shell = {
        "reward": settings.reward,
        "forecasts": settings.forecasts,
        "candidates": settings.candidates or None,
    }
    variants = [{**settings.environment, **own} for own in settings.variants or ({},)]
    parts = [SB3VecEnv(run.env, count, **shell, **variant) for variant in variants]
    _check_alike(parts, variants, settings.policy)
    env: BatchedVecEnv = SB3MixedVecEnv(parts) if len(parts) > 1 else parts[0]
    if not isinstance(env.action_space, spaces.Discrete):
        for name, asked in (("dqn", run.algo == "dqn"), ("a scorer", settings.policy == "scorer")):
            if asked:
                wanted = "candidates=K, or a joint library where there are several sensors (or --algo ppo, policy=mlp)"
                raise InputError(f"{name} cannot choose from {env.action_space}, expected {wanted}")
    if settings.teacher and env.get_attr("episodes", 0)[0].observer.shortlist:
        wanted = "'' (nearest): a teacher names actions, and the agent names ranks in a short list"
        raise InputError(f"teacher is {settings.teacher!r} with candidates={settings.candidates}, expected {wanted}")
    if discounts_seconds(settings) and not isinstance(env.get_attr("system", 0)[0], UnequalSteps):
        raise InputError(f"discount is 'second', expected 'step' (nearest): all steps of {run.env} are of one length")
    if (modes := _modes(settings)) > 1 and not isinstance(env.action_space, spaces.Box):
        raise InputError(f"modes is {modes}, expected 1: the actions of {run.env} are {env.action_space}, no box")
    return env


def _check_alike(parts: list[SB3VecEnv], variants: list[dict[str, Any]], policy: str) -> None:
    """Raise an InputError if an element of the observations, or an action, means different things in two variants."""
    first, *others = (signature(part.get_attr("system", 0)[0], policy) for part in parts)
    for own, variant in zip(others, variants[1:], strict=True):
        if unlike := difference(own, first):
            known = f"expected as with {variants[0] or 'the defaults'}"
            raise InputError(f"variants differ in what an agent sees or does: {unlike.name} with {variant}, {known}")


def try_out(run: TrainingRun) -> None:
    """Try one step of the run's environment, apart from the environments and generators of the training.

    Raises:
        InputError: a setting unknown to the environment, a missing file of recorded targets, or a reward that its
            system cannot give.
    """
    settings = run.settings
    env = _environments(run, 1)
    env.seed(training_seeds(BASE_SEED, run.seed, env.num_envs))
    env.action_space.seed(0)
    try:
        env.reset()
        env.step(np.array([env.action_space.sample()] * env.num_envs))
    except NotImplementedError as error:
        missing = f"its system does not offer what reward {settings.reward!r} needs"
        raise InputError(f"{run.env} cannot be trained in: {missing}, expected another reward") from error
    finally:
        env.close()


def model_bytes(model: BaseAlgorithm) -> bytes:
    """The bytes of ``model.save``: weights, optimiser, counters, last observations, settings."""
    file = io.BytesIO()
    model.save(file)
    return file.getvalue()
