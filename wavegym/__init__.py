"""Gymnasium environments in which a radar chooses its next waveform.

    >>> import gymnasium as gym
    >>> import wavegym
    >>> envs = gym.make_vec("wavegym/KershawEvansPosition-v0", num_envs=4)
    >>> observations, info = envs.reset(seed=0)
    >>> observations, rewards, terminated, truncated, info = envs.step(envs.action_space.sample())
    >>> bool((rewards == -info["cost"]).all())
    True

``wavegym.list_envs()`` lists the ids, ``print(wavegym.describe(id))`` shows observations and actions of an environment,
``wavegym.load_agent(id, "ppo")`` loads a trained agent. ``wavegym.waveforms``, ``wavegym.trackers`` and
``wavegym.schedulers`` are usable alone. The same on the command line: ``wavegym --help``.
"""

from __future__ import annotations

from typing import Any

from wavegym.core import VERSION
from wavegym.core.errors import InputError, InputWarning
from wavegym.core.policy import Policy
from wavegym.registration import list_envs, register, register_suite

__version__ = VERSION
__all__ = [
    "InputError",
    "InputWarning",
    "describe",
    "list_envs",
    "load_agent",
    "register",
    "register_chirp_law",
    "register_reward",
    "register_scheduler",
]

register_suite()


def describe(id: str, /, **parameters: Any) -> str:
    """Observations, actions and rewards of the environment ``id``, as Markdown tables (its page in the docs).

    With parameters: the environment that ``gym.make(id, **parameters)`` makes. Raises an InputError for an unknown id,
    or a parameter that is unknown or out of range.
    """
    from wavegym.envs.describe import describe as in_full

    return in_full(id, **parameters)


def load_agent(id: str, /, algo: str, **parameters: Any) -> Policy:
    """A trained agent, one that comes with the environment ``id`` or one's own, as a policy in plain NumPy.

    Args:
        id: the environment, with or without ``wavegym/``.
        algo: "ppo" or "dqn", or the folder of a training run.
        **parameters: parameters of the environment, such as ``action="joint"``.

    Raises:
        InputError: no such agent, or one that does not fit the environment.
    """
    from wavegym.evaluation.adapters import as_policy, is_folder
    from wavegym.evaluation.play import make_task
    from wavegym.policies.runs import load_pretrained

    task = make_task(id, parameters)
    if is_folder(algo):
        return as_policy(algo, task)
    return load_pretrained(task.env_id, algo, task.system)


def register_scheduler(name: str, make: Any) -> None:
    """Register a scheduler: ``--policies name`` and ``compare(id, {"name": None})`` then find it.

    Args:
        name: letters, digits, '-', '_' and '.'.
        make: ``make(system, tuning_worlds)`` returns a Policy. The worlds are tapes, axis 0 = world, on which constants
            may be tuned; none of them is a test world.

    Raises:
        InputError: the name is taken or has other characters, or ``make`` is not callable.
    """
    from wavegym.schedulers.registry import SCHEDULERS

    SCHEDULERS.register(name, make)


def register_reward(name: str, make: Any) -> None:
    """Register a reward: ``gym.make(id, reward=name)`` and ``wavegym train --setting reward=name`` then find it.

    Args:
        name: letters, digits, '-', '_' and '.'.
        make: ``make()`` returns a ``wavegym.envs.rewards.Reward``; a class of rewards without arguments is one.

    Raises:
        InputError: the name is taken or has other characters, or ``make`` is not callable.
    """
    from wavegym.envs.rewards import REWARDS

    REWARDS.register(name, make)


def register_chirp_law(name: str, law: Any) -> None:
    """Register a frequency law of chirps: the parameter ``laws=(name,)`` of systems with chirps then finds it.

    Args:
        name: letters, digits, '-', '_' and '.'.
        law: a ``wavegym.waveforms.FrequencyLaw``.

    Raises:
        InputError: an invalid or taken name, or a law that does not rise from 0 to 1 or has another phase.
    """
    from wavegym.waveforms.chirp_laws import CHIRP_LAWS

    CHIRP_LAWS.register(name, law)
