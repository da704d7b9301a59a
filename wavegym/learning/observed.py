"""The observations of a finished policy in its training environment, for ``policies.networks``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import System
from wavegym.evaluation import make_task, training_seeds
from wavegym.evaluation.play import play
from wavegym.learning.models import BASE_SEED
from wavegym.observations.observer import Observer
from wavegym.policies.networks import LearnedPolicy, TrainingRange

ENVS = 128  # episodes, in equal parts of all variants
LEAST = 4  # episodes of each variant


def range_in_training(
    policy: LearnedPolicy, env_id: str, seed: int, environment: dict[str, Any], variants: Sequence[dict[str, Any]]
) -> TrainingRange:
    """The range of what the policy observes in whole episodes of its training environment.

    Args:
        policy: the finished one.
        env_id: the full id.
        seed: of the training.
        environment: parameters in the training, ``max_episode_steps`` perhaps among them.
        variants: of these parameters; none: the environment as it is.
    """
    watched = _Watched(policy)
    count = max(ENVS // max(len(variants), 1), LEAST)
    for variant in variants or ({},):
        parameters = {**environment, **variant}
        limit = parameters.pop("max_episode_steps", None)
        task = make_task(env_id, parameters)
        task = task if limit is None else replace(task, max_episode_steps=limit)
        play(task, watched, training_seeds(BASE_SEED, seed, count))
    assert watched.range is not None
    return watched.range


class _Watched:
    """A policy whose observations are noted."""

    def __init__(self, policy: LearnedPolicy) -> None:
        self.policy = policy
        self.range: TrainingRange | None = None
        self._own, self._forecasts = 0, 0

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self.policy.begin(system, num_envs, rng)
        self._own = 0 if self.policy.network.is_alike else len(system.observation_fields)
        shown = Observer(system, self.policy.forecasts, self.policy.candidates).forecasts
        self._forecasts = len(shown.candidate_fields) if shown else 0

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        action = self.policy.act(belief, observation, mask)
        assert self.policy.shown is not None
        seen = TrainingRange.of(self.policy.shown, self._own, self._forecasts)
        self.range = seen if self.range is None else self.range.joined(seen)
        return action
