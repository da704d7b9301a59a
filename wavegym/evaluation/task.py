"""The task of a comparison: an environment's system with its parameters, without a Gymnasium shell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

from wavegym.core.system import System
from wavegym.envs.build import build_system
from wavegym.envs.scenario import scenario_differences
from wavegym.registration import SHELL, full_id, registered_system


@dataclass(frozen=True)
class Task:
    """One environment as evaluation needs it. It is sent to other processes, where the id may not be registered.

    Attributes:
        env_id: the full id.
        system: the closed loop.
        max_episode_steps: truncation before the system's own end, or None.
        parameters: of the system, those that differ from those registered.
        observation: what policies observe, "belief" or "measurements"; schedulers read the belief itself.
    """

    env_id: str
    system: System
    max_episode_steps: int | None
    parameters: Mapping[str, Any]
    observation: str = "belief"


def make_task(env_id: str, parameters: Mapping[str, Any]) -> Task:
    """The task of a registered environment.

    Args:
        env_id: with or without ``wavegym/``.
        parameters: of the system, other than the registered ones; "scenario" names a file of them.

    Raises:
        InputError: an unreadable scenario, an unknown id or parameter (nearest named), or a value out of range.
    """
    env_id = full_id(env_id)
    system, registered = registered_system(env_id)
    limit = registered.pop("max_episode_steps", gym.spec(env_id).max_episode_steps)
    of_file = scenario_differences(env_id, parameters.get("scenario", registered.get("scenario")))
    given = {name: value for name, value in {**of_file, **parameters}.items() if name != "scenario"}
    own = {name: value for name, value in registered.items() if name not in SHELL}  # the cost itself is reported
    complete = {**own, **given}
    observation = complete.pop("observation", registered.get("observation", "belief"))
    return Task(env_id, build_system(system, complete), limit, given, observation)
