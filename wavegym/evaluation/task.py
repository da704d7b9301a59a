"""What is compared on: an environment's system with its settings, apart from any shell."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

from wavegym.core.errors import InputError, check_choice
from wavegym.core.system import System
from wavegym.envs.build import build_system
from wavegym.registration import list_envs

SHELL = (
    "reward",
    "forecasts",
    "render_mode",
    "autoreset_mode",
)  # settings of a shell: a comparison reports the cost itself
NAMESPACE = "wavegym/"


@dataclass(frozen=True)
class Task:
    """One environment as evaluation needs it; travels to other processes, where ids may not be registered.

    Attributes:
        env_id: the full id.
        system: the closed loop.
        max_episode_steps: truncation before the system's own end, or None.
        settings: the system's parameters that differ from those registered.
    """

    env_id: str
    system: System
    max_episode_steps: int | None
    settings: Mapping[str, Any]


def make_task(env_id: str, settings: Mapping[str, Any]) -> Task:
    """The task of a registered environment.

    Raises:
        InputError: unknown id or setting (nearest named), or a value out of range.
    """
    env_id = full_id(env_id)
    spec = gym.spec(env_id)
    registered = {key: value for key, value in spec.kwargs.items() if key not in SHELL}
    system, limit = registered.pop("system"), registered.pop("max_episode_steps", spec.max_episode_steps)
    return Task(env_id, build_system(system, {**registered, **settings}), limit, dict(settings))


def full_id(env_id: str) -> str:
    """The registered id that ``env_id`` means: with or without ``wavegym/``; ``package:id`` imports a package first.

    Raises:
        InputError: there is none; the nearest is named.
    """
    package, colon, rest = env_id.rpartition(":")
    if colon:
        try:
            importlib.import_module(package)
        except ImportError as error:
            raise InputError(f"environment is {env_id!r}, expected an importable package before ':': {error}") from None
    return check_choice("environment", rest if "/" in rest else NAMESPACE + rest, list_envs())
