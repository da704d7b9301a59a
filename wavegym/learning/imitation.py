"""Imitation: the actor is pretrained on the actions of a scheduler, its teacher.

The first round is behaviour cloning. In later rounds the agent acts and the teacher labels (DAgger: Ross, Gordon and
Bagnell, 2011), so that the dataset holds the states that the agent visits. The labels of a rollout planner are the
advantages of all candidates, not only the best candidate: one step of policy iteration by regression (Lagoudakis and
Parr, 2003). Two futures for each candidate are enough.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import joblib
import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import DQN
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.distributions import DiagGaussianDistribution

from wavegym.core.arrays import Array
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.core.work import Parts
from wavegym.core.worlds import draw_worlds, training_seeds, word
from wavegym.learning.export import export
from wavegym.learning.mixture import parts
from wavegym.learning.scorer import Dueling
from wavegym.learning.settings import Settings
from wavegym.observations.observer import Observer
from wavegym.policies.networks import LearnedPolicy
from wavegym.schedulers.heuristics.grids import HEURISTICS
from wavegym.schedulers.planners import RolloutPlanner
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.rollout import allowed
from wavegym.schedulers.tuned_constants import record_key, records

BASE_SEED = word("lessons")  # frozen: it seeds the worlds of all trained agents
TUNING = 200  # worlds on which a teacher's constants are tuned
BATCH = 256
ADVANTAGE_SCALE = 20.0  # logit of an advantage as large as the whole cost
MOST = 10.0  # bound of a label's logit
INVERSE_TEMPERATURE = 6.0  # factor of the logits after imitation: exploration stays near the greedy choice
MARGIN = 0.2  # of Q values, in mean costs of a step
REFUSED = -1e8  # logit of a candidate that is not allowed
NEAR = 0.02  # of a box's half width: a choice this close to the best point costs little more
RATE = 3e-3  # Adam's learning rate at the start; falls linearly to 0


class Lessons(NamedTuple):
    """The lessons of an agent: the decisions of a round, or of all rounds so far."""

    observations: Array  # (decision, elements)
    labels: Array  # (decision, ...), see ``demonstrations``


def pretrain(
    model: BaseAlgorithm, settings: Settings, systems: list[System], seed: int, parts: Parts | None = None
) -> None:
    """Let the agent imitate ``settings.teacher``; its constants are recorded ones, or tuned on training worlds.

    If the settings change parameters of the environment, a heuristic keeps the constants of the defaults. It is only a
    first guide, and a search in every run would take longer than the learning.

    Args:
        model: PPO or DQN, untrained.
        settings: teacher, rounds and episodes of the imitation.
        systems: the closed loop of each variant; an equal share of the episodes is played in each.
        seed: training seed.
        parts: where the lessons of each round are kept and looked for: they take most of the time.
    """
    seeds = training_seeds(BASE_SEED, seed, settings.teacher_episodes * settings.imitation_rounds)
    teacher = _teacher(settings, systems, seed)
    guide = teacher.futures.base if isinstance(teacher, RolloutPlanner) else teacher
    rounds: list[Lessons] = []
    for n in range(settings.imitation_rounds):
        actor = LearnedPolicy(export(model.policy), settings.forecasts) if n else guide
        key = str(joblib.hash((settings, seed, n)))
        found = None if parts is None else parts.get(key)
        if found is None:
            own = seeds[n * settings.teacher_episodes : (n + 1) * settings.teacher_episodes]
            found = _round(settings, systems, teacher, actor, own, np.random.default_rng([seed, n]))
            if parts is not None:
                parts.put(key, found)
        rounds.append(found)
        observations, labels = (np.concatenate(arrays) for arrays in zip(*rounds, strict=True))
        imitate(model, observations, labels, settings.imitation_epochs, np.random.default_rng([seed, n]))
    if isinstance(model, DQN):  # advantages of a rollout are close to differences of Q
        model.q_net_target.load_state_dict(model.q_net.state_dict())
    elif isinstance(teacher, RolloutPlanner) or isinstance(model.action_space, spaces.Box):
        calibrate_temperature(model)


def _teacher(settings: Settings, systems: list[System], seed: int) -> Policy:
    """The teacher, a rollout planner with the futures of the settings."""
    constants = records().get(record_key(systems[0]), {}).get(settings.teacher)
    if (settings.environment or settings.variants) and constants is not None:
        return HEURISTICS[settings.teacher].make(**constants)
    teacher = make_policy(
        settings.teacher, systems[0], draw_worlds(systems[0], training_seeds(BASE_SEED, seed, TUNING))
    )
    if isinstance(teacher, RolloutPlanner):
        teacher.futures.count = settings.teacher_futures
    return teacher


def _round(
    settings: Settings,
    systems: list[System],
    teacher: Policy,
    actor: Policy,
    seeds: Sequence[int],
    rng: np.random.Generator,
) -> Lessons:
    """One round of lessons, an equal share of the worlds in each variant."""
    each = [
        demonstrations(
            system, teacher, actor, draw_worlds(system, seeds[k :: len(systems)]), settings.forecasts, rng,
            settings.query_every,
        )
        for k, system in enumerate(systems[: settings.teacher_episodes])
    ]  # fmt: skip
    return Lessons(*(np.concatenate(arrays) for arrays in zip(*each, strict=True)))


def demonstrations(
    system: System,
    teacher: Policy,
    actor: Policy,
    worlds: Any,
    forecasts: bool,
    rng: np.random.Generator,
    every: int = 1,
) -> tuple[Array, Array]:
    """A dataset: observations of the episodes that ``actor`` plays on ``worlds``, with the teacher's labels.

    The teacher is queried every ``every`` steps on average, at random, and at each of the first ``every`` steps, in
    which much changes. If the teacher is the actor, it repeats its last action between queries. ``rng`` is the
    generator of the queries and of the policies.

    Returns:
        Observations (decision, elements) and labels: the teacher's actions (decision, ...); for a RolloutPlanner,
        logits from its advantages (decision, candidate), NaN for a candidate that is not allowed.
    """
    observer, state = Observer(system, forecasts), system.initial(worlds)
    for policy in {id(teacher): teacher, id(actor): actor}.values():
        policy.begin(system, len(state.belief.step), rng)
    seen: list[Array] = []
    labels: list[Array] = []
    while not (over := system.terminal(state.belief)).all():
        mask = allowed(system, state.belief)
        observation, _ = observer(state.belief)
        if len(seen) < every or every == 1 or rng.random() < 1.0 / every:
            label = _label(teacher, state.belief, observation, mask)
            seen.append(observation[~over])
            labels.append(label[~over])
        action = label if actor is teacher else actor.act(state.belief, observation, mask)
        state = system.transition(state, action, worlds)
    return np.concatenate(seen), np.concatenate(labels)


def _label(teacher: Policy, belief: Any, observation: Array, mask: Array | None) -> Array:
    """See ``demonstrations``."""
    if isinstance(teacher, RolloutPlanner):
        return np.clip(ADVANTAGE_SCALE * teacher.advantages(belief, mask), -MOST, MOST).astype(np.float32)
    return teacher.act(belief, observation, mask)


def imitate(model: BaseAlgorithm, observations: Array, labels: Array, epochs: int, rng: np.random.Generator) -> None:
    """Fit the actor to the labels: actions, or logits of a distribution over candidates."""
    seen, wanted = torch.as_tensor(observations), torch.as_tensor(labels)
    optimiser = torch.optim.Adam(actor_parameters(model), lr=RATE)
    steps = max(1, epochs * len(seen) // BATCH)
    for step in range(steps):
        optimiser.param_groups[0]["lr"] = RATE * (1.0 - step / steps)
        batch = torch.as_tensor(rng.integers(len(seen), size=BATCH))
        loss = _loss(model, seen[batch], wanted[batch])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()


def _loss(model: BaseAlgorithm, seen: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """The loss of the actor on a batch of labels."""
    if isinstance(model.action_space, spaces.Discrete) and wanted.is_floating_point():
        return _cross_entropy(preferences(model, seen), wanted)
    if isinstance(model, DQN):  # Hester et al., 2018: Q of the label exceeds the others by a margin
        return torch.nn.functional.multi_margin_loss(preferences(model, seen), wanted, margin=MARGIN)
    policy: Any = model.policy
    chosen = policy.get_distribution(seen)
    if isinstance(model.action_space, spaces.Box):
        return _box_loss(chosen, wanted.float())
    return -chosen.log_prob(wanted).mean()


def preferences(model: BaseAlgorithm, seen: torch.Tensor) -> torch.Tensor:
    """Logits of the actor, or Q values, (env, action); only their differences matter."""
    policy: Any = model.policy
    return policy.q_net(seen) if isinstance(model, DQN) else policy.get_distribution(seen).distribution.logits


def calibrate_temperature(model: BaseAlgorithm) -> None:
    """Lower the actor's temperature without changing its greedy choices; noisy labels keep it too high.

    In a box, imitation does not fit the standard deviation: it is set to ``NEAR``.
    """
    policy: Any = model.policy
    if isinstance(model.action_space, spaces.Box):
        with torch.no_grad():
            policy.log_std.fill_(math.log(NEAR))
        return
    is_scorer = isinstance(policy.action_net, torch.nn.Identity)
    last = policy.mlp_extractor.policy_net.score if is_scorer else policy.action_net
    with torch.no_grad():
        for parameter in last.parameters():
            parameter *= INVERSE_TEMPERATURE


def _cross_entropy(logits: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """Mean cross-entropy from the softmax of the labels, over the allowed candidates."""
    refused = wanted.isnan()
    wanted, logits = (values.masked_fill(refused, REFUSED) for values in (wanted, logits))
    return torch.nn.functional.cross_entropy(logits, wanted.softmax(dim=1))


def _box_loss(chosen: DiagGaussianDistribution, wanted: torch.Tensor) -> torch.Tensor:
    """Negative log-likelihood of the labels in a box [-1, 1], with Huber's loss as the error of each mode.

    With several modes the actor follows a teacher that switches between points, instead of averaging them. A point
    beyond the edge counts as at the edge.
    """
    log_weights, points = parts(chosen)
    wanted = wanted[:, None].expand_as(points)
    is_there = (wanted.abs() >= 1.0) & (points * wanted >= 1.0)
    points = torch.where(is_there, wanted, points)
    off = torch.nn.functional.smooth_l1_loss(points, wanted, beta=NEAR, reduction="none").sum(dim=2) / NEAR
    return -torch.logsumexp(log_weights - off, dim=1).mean()


def actor_parameters(model: BaseAlgorithm) -> list[torch.nn.Parameter]:
    """The parameters that choose; all others are the critic's. Without a separate V, a Q network has no critic."""
    if isinstance(model, DQN):
        network: Any = model.q_net.q_net
        return list((network.scorer if has_critic(model) else network).parameters())
    return [p for name, p in model.policy.named_parameters() if "value_net" not in name]


def has_critic(model: BaseAlgorithm) -> bool:
    """Whether state values have parameters of their own: in PPO and in a dueling Q network."""
    return not isinstance(model, DQN) or isinstance(model.q_net.q_net, Dueling)


class WarmUp(BaseCallback):
    """Freezes the actor after imitation until the critic, if there is one, has learned its values.

    Args:
        steps: environment steps in which only the critic learns.
    """

    def __init__(self, steps: int) -> None:
        super().__init__()
        self.steps = steps

    def _on_rollout_start(self) -> None:
        is_free = self.model.num_timesteps >= self.steps
        for parameter in actor_parameters(self.model) if has_critic(self.model) else ():
            parameter.requires_grad_(is_free)

    def _on_step(self) -> bool:
        return True
