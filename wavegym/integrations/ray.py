"""wavegym on Ray: environments for RLlib, and evaluation on a cluster. Needs ``pip install 'wavegym[ray]'``.

    import wavegym.integrations.ray

    wavegym.integrations.ray.register_envs()  # RLlib's workers then know every id

An id makes a single environment or a native batch, with action masks on request. RLlib makes an environment in a worker
that imports neither wavegym nor the user's modules, so an id alone is unknown there. ``register_envs`` hands Ray the
environments' specifications.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector.utils import batch_space
from ray.tune.registry import register_env

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.work import cluster
from wavegym.registration import list_envs

__all__ = ["cluster", "register_envs"]

MASKS, BATCH = "masks", "num_envs"


def register_envs() -> None:
    """Make every id of ``wavegym.list_envs()`` known to RLlib: ``PPOConfig().environment(id, env_config={...})``.

    ``env_config`` holds parameters and settings of the environment, as for ``gym.make``. With ``"masks": True`` an
    observation is a dictionary of "observations" and "action_mask", as RLlib's ``ActionMaskingTorchRLModule`` expects
    it. Call it again after registering an environment of your own.
    """
    for env_id in list_envs():
        register_env(env_id, partial(make, gym.spec(env_id)))


def make(spec: EnvSpec, config: Mapping[str, Any]) -> gym.Env | gym.vector.VectorEnv:
    """The environment of a specification: a native batch if ``config`` has ``num_envs``, otherwise a single one.

    Args:
        spec: of a registered environment, which the calling process may not know.
        config: RLlib's ``env_config``.

    Raises:
        InputError: see ``gym.make``; masks of actions that are not Discrete.
    """
    settings = dict(config)
    masked, batch = settings.pop(MASKS, False), settings.pop(BATCH, None)
    gym.registry.setdefault(spec.id, spec)
    if batch is None:
        env = gym.make(spec.id, **settings)
        return MaskInObservation(env) if masked else env
    envs = gym.make_vec(spec.id, num_envs=batch, **settings)
    return MaskInObservations(envs) if masked else envs


def masked_space(observations: spaces.Space, actions: spaces.Space) -> spaces.Dict:
    """The space of observations with masks. InputError for actions that are not Discrete."""
    if not isinstance(actions, spaces.Discrete):
        raise InputError(f"masks is True and the action space {actions}, expected a Discrete one (nearest: "
                         "action='joint', or masks=False)")  # fmt: skip
    return spaces.Dict({"observations": observations, "action_mask": spaces.Box(0.0, 1.0, (int(actions.n),))})


class MaskInObservation(gym.ObservationWrapper):
    """The observation and the mask of a single environment, (actions,) float32 of 0 and 1."""

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        self.observation_space = masked_space(env.observation_space, env.action_space)

    def observation(self, observation: Array) -> dict[str, Array]:
        """The observation with the mask of now."""
        return {"observations": observation, "action_mask": self.get_wrapper_attr("action_masks")().astype(np.float32)}


class MaskInObservations(gym.vector.VectorObservationWrapper):
    """The observations and masks of a batch, (env, actions) float32 of 0 and 1."""

    def __init__(self, env: gym.vector.VectorEnv) -> None:
        super().__init__(env)
        self.single_observation_space = masked_space(env.single_observation_space, env.single_action_space)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def observations(self, observations: Array) -> dict[str, Array]:
        """The observations with the masks of now."""
        batch: Any = self.unwrapped
        return {"observations": observations, "action_mask": batch.action_masks().astype(np.float32)}
