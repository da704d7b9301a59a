"""The task of a comparison: an environment's system with its settings, without a Gymnasium shell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

from wavegym.core.system import System
from wavegym.envs.build import build_system
from wavegym.registration import SHELL, full_id


@dataclass(frozen=True)
class Task:
    """One environment as evaluation needs it. It is sent to other processes, where the id may not be registered.

    Attributes:
        env_id: the full id.
        system: the closed loop.
        max_episode_steps: truncation before the system's own end, or None.
        settings: the system's parameters that differ from those registered.
        observation: what policies observe, "belief" or "measurements"; schedulers read the belief itself.
    """

    env_id: str
    system: System
    max_episode_steps: int | None
    settings: Mapping[str, Any]
    observation: str = "belief"


def make_task(env_id: str, settings: Mapping[str, Any]) -> Task:
    """The task of a registered environment.

    Raises:
        InputError: unknown id or setting (nearest named), or a value out of range.
    """
    env_id = full_id(env_id)
    spec = gym.spec(env_id)
    registered = {key: value for key, value in spec.kwargs.items() if key not in SHELL}  # the cost itself is reported
    system, limit = registered.pop("system"), registered.pop("max_episode_steps", spec.max_episode_steps)
    parameters = {**registered, **settings}
    observation = parameters.pop("observation", spec.kwargs.get("observation", "belief"))
    return Task(env_id, build_system(system, parameters), limit, dict(settings), observation)
