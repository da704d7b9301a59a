"""Training settings: settings.toml, checked and closed to unknown names, and those of the command line."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from wavegym.core.errors import InputError, check_choice
from wavegym.core.parameters import Count, NonNegative, Positive, make_checked
from wavegym.registration import RECORDS, list_envs

# Arguments of gymnasium.make_vec that are no parameters of a system, and the alternative here.
SHELL = {
    "num_envs": "--setting num_envs=N",
    "reward": "--setting reward=NAME",
    "forecasts": "--setting forecasts=true",
    "candidates": "--setting candidates=K",
    "measurements": "none: agents read no measurements from info",
    "observation": "none: agents observe the belief",
    "autoreset_mode": "none: training needs SameStep",
    "num_threads": "none: batches of training are too small for threads to gain",
    "scenario": "the file in place of the environment's id",
    "render_mode": "none: training renders nothing",
    "vectorization_mode": "none: training uses the native batch",
    "vector_kwargs": "none: training uses the native batch",
    "wrappers": "none: training uses the native batch",
    "system": "another environment id",
    "id": "another environment id",
    "env": "another environment id",
}
FILE = Path(__file__).with_name("settings.toml")

NonNegativeCount = Annotated[int, Field(ge=0)]
Several = Annotated[int, Field(ge=2)]
Share = Annotated[float, Field(ge=0, le=1)]


@dataclass(frozen=True, kw_only=True, config=ConfigDict(extra="forbid"))
class Settings:
    """Settings of all algorithms, whose values stand in settings.toml.

    Only ``environment`` and ``variants`` have defaults here.

    Attributes:
        steps: environment steps of a run, all environments together.
        num_envs: number of environments in the batch.
        reward: the environment's training reward.
        forecasts: whether the observation holds forecasts of each candidate.
        candidates: length of the short list from which the agent chooses; 0: it chooses from all actions.
        policy: "mlp", or "scorer": one network that scores every candidate alike (``learning.scorer``).
        network: widths of the hidden layers; for a scorer, of the trunk and of each round after the trunk.
        activation: of the hidden layers.
        learning_rate: Adam's learning rate at the start; falls linearly to 0.
        gamma: discount factor; with 0 the agent learns a one-step scheduler.
        batch_size: transitions in a gradient step.
        max_grad_norm: bound of the gradient's norm.
        teacher: the scheduler that the agent imitates before reinforcement learning; "" for none. The labels of a
            rollout planner ("rollout:H") are the advantages of all candidates. A heuristic has the constants recorded
            for the environment's defaults, also where ``environment`` changes its parameters.
        teacher_futures: sampled futures of each candidate, if the teacher is a rollout planner.
        teacher_episodes: labelled episodes in each round of imitation.
        imitation_rounds: rounds of imitation. In all but the first the agent acts and the teacher labels (DAgger).
        query_every: query the teacher every N steps on average, and at each of the first N steps; between queries the
            teacher repeats its last action. More than 1 is only for a teacher without memory.
        imitation_epochs: passes over the dataset so far, after each round.
        critic_warm_up: rollouts after imitation (DQN: steps of the batch) in which only the critic learns. If they fill
            the run, the actor stays as imitation left it.
        environment: parameters of the environment that replace its defaults.
        variants: further parameters, in which equal shares of the environments differ: an agent learns all of them.
    """

    steps: Count
    num_envs: Count
    reward: str
    forecasts: bool
    candidates: NonNegativeCount
    policy: Literal["mlp", "scorer"]
    network: tuple[Count, ...]
    activation: Literal["tanh", "relu"]
    learning_rate: Positive
    gamma: Share
    batch_size: Count
    max_grad_norm: Positive
    teacher: str
    teacher_futures: Count
    teacher_episodes: Count
    imitation_rounds: Count
    query_every: Count
    imitation_epochs: Count
    critic_warm_up: NonNegativeCount
    environment: dict[str, Any] = dataclasses.field(default_factory=dict)
    variants: tuple[dict[str, Any], ...] = ()


@dataclass(frozen=True, kw_only=True, config=ConfigDict(extra="forbid"))
class PPOSettings(Settings):
    """Proximal policy optimisation; see Stable-Baselines3's PPO. ``n_steps`` is the rollout of each environment.

    Advantages are divided by their standard deviation over a batch, so a batch needs two transitions.

    Attributes:
        masks: whether forbidden actions are masked (sb3-contrib's MaskablePPO).
        discount: what gamma is a factor of: "step", or "second" of a step's duration (``training.time_discount``).
        modes: number of Gaussians over a box (``learning.mixture``); 1: a plain Gaussian.
    """

    masks: bool
    discount: Literal["step", "second"]
    modes: Count
    batch_size: Several
    n_steps: Count
    n_epochs: Count
    gae_lambda: Share
    clip_range: Positive
    ent_coef: NonNegative
    vf_coef: NonNegative


@dataclass(frozen=True, kw_only=True, config=ConfigDict(extra="forbid"))
class DQNSettings(Settings):
    """Deep Q-learning; see Stable-Baselines3's DQN. ``gradient_steps`` follow every step of the batch.

    Attributes:
        n_steps: length of the n-step returns.
    """

    n_steps: Count

    buffer_size: Count
    learning_starts: NonNegativeCount
    gradient_steps: Count
    target_update_interval: Count
    exploration_initial_eps: Share
    exploration_fraction: Share
    exploration_final_eps: Share


ALGORITHMS: dict[str, type[Settings]] = {"ppo": PPOSettings, "dqn": DQNSettings}


def load_settings(
    env_id: str,
    algo: str,
    chosen: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    file: Path = FILE,
) -> Settings:
    """Settings of ``algo`` in ``env_id``: the algorithm's, the ``like`` table's, the environment's, then ``chosen``.

    Args:
        env_id: a registered id; without a table of its own it takes the settings of its registration.
        algo: "ppo" or "dqn".
        chosen: further settings by name.
        parameters: of the environment, further ones by name. They hold in all variants of the file.
        file: the settings file.

    Raises:
        InputError: an unknown table, algorithm or setting (nearest named), or a value out of range.
    """
    check_choice("algorithm", algo, ALGORITHMS)
    tables = _tables(file)
    registered = RECORDS[env_id].settings if env_id in RECORDS else {}
    for name in registered:
        check_choice(f"algorithm in the settings of {env_id}", name, ALGORITHMS)
    own = dict(tables.get(env_id, registered).get(algo, {}))
    layers = [tables.get(algo, {}), own, chosen or {}]
    if "like" in own:
        shared = check_choice(
            f"like in table {env_id!r} of {file.name}", own.pop("like"), tables.keys() - {*ALGORITHMS, env_id}
        )
        layers.insert(1, tables[shared].get(algo, {}))
    values = {key: value for layer in layers for key, value in layer.items()}
    layered = [layer.get("environment", {}) for layer in layers] + [parameters or {}]
    values["environment"] = {key: value for layer in layered for key, value in layer.items()}
    if "variants" not in (chosen or {}):
        values["variants"] = _without(values.get("variants", ()), {**layered[-2], **layered[-1]})
    settings = make_checked(ALGORITHMS[algo], values, source=" in the settings file")
    for name in SHELL.keys() & set().union(settings.environment, *settings.variants):
        raise InputError(f"{name!r} is no parameter of an environment's system, expected {SHELL[name]}")
    if settings.num_envs % (count := max(len(settings.variants), 1)):
        nearest = count * max(round(settings.num_envs / count), 1)
        raise InputError(
            f"num_envs is {settings.num_envs}, expected a multiple of the {count} variants (nearest: {nearest})"
        )
    if settings.policy == "scorer" and not settings.network:
        raise InputError("network is (), expected at least one width for a scorer (nearest: (64,))")
    if isinstance(settings, PPOSettings) and settings.n_steps * settings.num_envs < 2:
        raise InputError("n_steps times num_envs is 1, expected >= 2 transitions in a rollout (nearest: n_steps=2)")
    return settings


def _without(variants: Sequence[Mapping[str, Any]], given: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The variants without the parameters that are given; none if nothing is left that differs."""
    left = [{name: value for name, value in variant.items() if name not in given} for variant in variants]
    return left if any(left) else []


def _tables(file: Path) -> dict[str, Any]:
    try:
        tables = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"settings file {file} cannot be read: {error}") from None
    for name, table in tables.items():
        if name not in ALGORITHMS:
            if name not in _shared(tables):
                check_choice(f"table of {file.name}", name, [*ALGORITHMS, *list_envs()])
            for algo in table:
                check_choice(f"table {name!r} of {file.name}", algo, ALGORITHMS)
    return tables


def _shared(tables: dict[str, Any]) -> set[str]:
    """Names of the tables that a ``like`` entry names."""
    groups = (table for name, table in tables.items() if name not in ALGORITHMS)
    return {own["like"] for table in groups for own in table.values() if isinstance(own, dict) and "like" in own}
