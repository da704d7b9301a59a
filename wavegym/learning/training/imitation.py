"""Imitation: the actor learns from a scheduler what it would do, before it learns by itself.

Behaviour cloning in the first round; in later ones the learner acts and the teacher says what it would have done
(DAgger: Ross, Gordon and Bagnell, 2011), so that the lessons hold the situations that the learner gets into. Of a
planner that follows its base in rollouts the learner is told what each candidate saves, not only which is the best: one
step of policy iteration by regression (Lagoudakis and Parr, 2003), for which two futures a candidate are enough.
"""

from __future__ import annotations

import math
from typing import Any

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
from wavegym.evaluation.worlds import draw_worlds, training_seeds, word
from wavegym.learning.policies.export import export
from wavegym.learning.policies.mixture import parts
from wavegym.learning.policies.scorer import Dueling
from wavegym.learning.settings import Settings
from wavegym.observations.observer import Observer
from wavegym.policies.networks import LearnedPolicy
from wavegym.schedulers.planners import RolloutPlanner
from wavegym.schedulers.registry import make_policy
from wavegym.schedulers.rollout import allowed

ROOT = word("lessons")  # seeds the worlds of all trained agents: frozen, whatever the words around it become
TUNING = 200  # worlds for a teacher that is to be tuned
BATCH = 256
SHARPNESS = 20.0  # logits for a saving of the whole cost
MOST = 10.0  # of a logit
SHARPER = 6.0  # factor of the logits after such lessons: what the actor tries stays near what it will play
MARGIN = 0.2  # of Q, in steps' mean costs
REFUSED = -1e8  # logit of a candidate that is not allowed
NEAR = 0.02  # of a box's half width: about as far from the best point a choice may be without costing much
RATE = 3e-3  # Adam's, at the start; falls to 0


def pretrain(model: BaseAlgorithm, settings: Settings, system: System, seed: int) -> None:
    """Let the learner imitate ``settings.teacher``, whose constants are those recorded or tuned on training worlds.

    Args:
        model: PPO or DQN, untrained.
        settings: what of the lessons, how many.
        system: the closed loop.
        seed: number of the training run.
    """
    seeds = training_seeds(ROOT, seed, settings.teacher_episodes * settings.imitation_rounds)
    tuning = draw_worlds(system, training_seeds(ROOT, seed, TUNING))
    teacher = make_policy(settings.teacher, system, tuning)
    guide = teacher
    if isinstance(teacher, RolloutPlanner):
        teacher.futures.count, guide = settings.teacher_futures, teacher.futures.base
    dataset: list[tuple[Array, Array]] = []
    for n in range(settings.imitation_rounds):
        worlds = draw_worlds(system, seeds[n * settings.teacher_episodes : (n + 1) * settings.teacher_episodes])
        actor = LearnedPolicy(export(model.policy), settings.forecasts) if n else guide
        rng = np.random.default_rng([seed, n])
        dataset.append(demonstrations(system, teacher, actor, worlds, settings.forecasts, rng, settings.query_every))
        observations, labels = (np.concatenate(arrays) for arrays in zip(*dataset, strict=True))
        imitate(model, observations, labels, settings.imitation_epochs, np.random.default_rng([seed, n]))
    if isinstance(model, DQN):  # what a rollout saves is about what Q differs by
        model.q_net_target.load_state_dict(model.q_net.state_dict())
    elif isinstance(teacher, RolloutPlanner) or isinstance(model.action_space, spaces.Box):
        calibrate_temperature(model)


def demonstrations(
    system: System,
    teacher: Policy,
    actor: Policy,
    worlds: Any,
    forecasts: bool,
    rng: np.random.Generator,
    every: int = 1,
) -> tuple[Array, Array]:
    """What the teacher would do at steps of the episodes that ``actor`` plays on ``worlds``; ``rng`` is theirs.

    With ``every`` above 1 it is asked at each of the first so many steps, in which much changes, and then once in so
    many, at random; where it is the actor itself, it does in between what it did last.

    Returns:
        Observations (decision, elements), and the teacher's actions (decision, ...); or, of a RolloutPlanner, the
        logits (decision, candidate) that its advantages are worth, NaN where a candidate is not allowed.
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
            answer = _answer(teacher, state.belief, observation, mask)
            seen.append(observation[~over])
            labels.append(answer[~over])
        done = answer if actor is teacher else actor.act(state.belief, observation, mask)
        state = system.transition(state, done, worlds)
    return np.concatenate(seen), np.concatenate(labels)


def _answer(teacher: Policy, belief: Any, observation: Array, mask: Array | None) -> Array:
    """See ``demonstrations``."""
    if isinstance(teacher, RolloutPlanner):
        return np.clip(SHARPNESS * teacher.advantages(belief, mask), -MOST, MOST).astype(np.float32)
    return teacher.act(belief, observation, mask)


def imitate(model: BaseAlgorithm, observations: Array, labels: Array, epochs: int, rng: np.random.Generator) -> None:
    """Bring the actor to what it was told: actions, or the distribution that logits stand for."""
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
    """How far the actor is from what it was told."""
    if isinstance(model.action_space, spaces.Discrete) and wanted.is_floating_point():
        return _surprise(preferences(model, seen), wanted)
    if isinstance(model, DQN):  # Hester et al., 2018: the teacher's choice is worth more than any other by a margin
        return torch.nn.functional.multi_margin_loss(preferences(model, seen), wanted, margin=MARGIN)
    policy: Any = model.policy
    chosen = policy.get_distribution(seen)
    if isinstance(model.action_space, spaces.Box):
        return _distance(chosen, wanted.float())
    return -chosen.log_prob(wanted).mean()


def preferences(model: BaseAlgorithm, seen: torch.Tensor) -> torch.Tensor:
    """Of each action, (env, action): the actor's, or the values of Q, of which only differences count."""
    policy: Any = model.policy
    return policy.q_net(seen) if isinstance(model, DQN) else policy.get_distribution(seen).distribution.logits


def calibrate_temperature(model: BaseAlgorithm) -> None:
    """Make the actor surer of the same choices; noise in what it was told had kept it undecided.

    In a box, where lessons say nothing of it, it becomes as sure as is worth anything.
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
            parameter *= SHARPER


def _surprise(logits: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """Mean cross-entropy from the softmax of what was wanted, over the allowed candidates."""
    refused = wanted.isnan()
    wanted, logits = (values.masked_fill(refused, REFUSED) for values in (wanted, logits))
    return torch.nn.functional.cross_entropy(logits, wanted.softmax(dim=1))


def _distance(chosen: DiagGaussianDistribution, wanted: torch.Tensor) -> torch.Tensor:
    """How unlikely the wanted points of a box [-1, 1] are, were errors distributed as Huber's loss would have it.

    A teacher that switches between points is to be followed, not met halfway. Beyond the box's edge is at its edge.
    """
    log_weights, points = parts(chosen)
    wanted = wanted[:, None].expand_as(points)
    is_there = (wanted.abs() >= 1.0) & (points * wanted >= 1.0)
    points = torch.where(is_there, wanted, points)
    off = torch.nn.functional.smooth_l1_loss(points, wanted, beta=NEAR, reduction="none").sum(dim=2) / NEAR
    return -torch.logsumexp(log_weights - off, dim=1).mean()


def actor_parameters(model: BaseAlgorithm) -> list[torch.nn.Parameter]:
    """What chooses; all else is the critic's. A network of Q that has no V of its own chooses as a whole."""
    if isinstance(model, DQN):
        network: Any = model.q_net.q_net
        return list((network.scorer if has_critic(model) else network).parameters())
    return [p for name, p in model.policy.named_parameters() if "value_net" not in name]


def has_critic(model: BaseAlgorithm) -> bool:
    """Whether what states are worth is learned apart from what chooses: in PPO, and in a dueling network of Q."""
    return not isinstance(model, DQN) or isinstance(model.q_net.q_net, Dueling)


class WarmUp(BaseCallback):
    """Keeps the actor as it was taught until the critic, if there is one, knows what that is worth.

    Args:
        steps: environment steps for which only the critic learns.
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
