"""From a plan to an untrained Stable-Baselines3 model with its environments."""

from __future__ import annotations

import dataclasses
import io

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import LinearSchedule

from agents.plan import Plan
from agents.runs import MODELS
from wavegym.envs.sb3 import SB3VecEnv
from wavegym.errors import InputError
from wavegym.evaluation import training_seeds

ROOT = 0  # of the training worlds' seeds; test worlds differ from them whatever their root is
ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}
TRANSLATED = (
    "steps",
    "num_envs",
    "reward",
    "network",
    "activation",
    "learning_rate",
    "environment",
)  # the rest is SB3's


def build_model(plan: Plan) -> BaseAlgorithm:
    """The model, every generator seeded.

    Raises:
        InputError: a setting that the environment does not know, or actions that the algorithm cannot choose.
    """
    settings = plan.settings
    env = SB3VecEnv(plan.env, settings.num_envs, reward=settings.reward, **settings.environment)
    own = {f.name: getattr(settings, f.name) for f in dataclasses.fields(settings) if f.name not in TRANSLATED}
    if plan.algo == "dqn":
        own["train_freq"] = 1
        if not isinstance(env.action_space, spaces.Discrete):
            wanted = "a finite library, the joint one where there are several sensors (or --algo ppo)"
            raise InputError(f"dqn cannot choose from {env.action_space}, expected {wanted}")
    model = MODELS[plan.algo](
        "MlpPolicy",
        env,
        learning_rate=LinearSchedule(settings.learning_rate, 0.0, 1.0),
        policy_kwargs={"net_arch": list(settings.network), "activation_fn": ACTIVATIONS[settings.activation]},
        seed=plan.seed,
        device="cpu",
        **own,
    )
    env.seed(training_seeds(ROOT, plan.seed, settings.num_envs))
    return model


def try_out(plan: Plan) -> None:
    """One step of the plan's environment, apart from the training's own environments and generators.

    Raises:
        InputError: a setting that the environment does not know, a missing file of recorded targets and the like, or a
            reward that its system cannot give.
    """
    settings = plan.settings
    env = SB3VecEnv(plan.env, 1, reward=settings.reward, **settings.environment)
    env.seed(training_seeds(ROOT, plan.seed, 1))
    env.action_space.seed(0)
    try:
        env.reset()
        env.step(np.array([env.action_space.sample()]))
    except NotImplementedError as error:
        missing = f"its system does not offer what reward {settings.reward!r} needs"
        raise InputError(f"{plan.env} cannot be trained in: {missing}, expected another reward") from error
    finally:
        env.close()


def model_bytes(model: BaseAlgorithm) -> bytes:
    """What ``model.save`` writes: weights, optimiser, counters, last observations, settings."""
    file = io.BytesIO()
    model.save(file)
    return file.getvalue()
