"""Sampled futures of a belief under plans and a base policy; all plans meet the same outcomes."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.schedulers.heuristics.base import Heuristic
from wavegym.schedulers.rollout import allowed

ROWS = 16_384  # beliefs simulated at a time: they fit the processor's cache


class Observing(Heuristic):
    """Any policy as a base: at every belief, also a simulated one, it receives the observation of that belief.

    Args:
        policy: chooses the actions, such as a learned policy.
    """

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        from wavegym.observations.observer import Observer  # above the heuristics, whose delays its forecasts show

        self.policy.begin(system, num_envs, rng)
        self._observer = Observer(system)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        return np.array(self.policy.act(belief, self._observer(belief)[0], mask))  # a planner may write to it


class SampledFutures:
    """Follows plans, and after them a base policy, through ``predict``.

    Args:
        base: chooses where a plan has ended. For a heuristic (``wavegym.schedulers.heuristics``), ``prepare`` is called
            at the first belief of the futures and ``choose`` in them. For any other policy ``act`` is called, with the
            observation of each belief. If the base has ``leftover(belief, prepared)``, (env,), it is added to the cost
            at the end of a truncated future: minus the value of the remaining resources.
        depth: steps of a future, fewer where the episode ends.
        count: number of futures; a single one where no outcome is random.

    Raises:
        InputError: no step, no future.
    """

    def __init__(self, base: Policy, depth: int, count: int) -> None:
        is_heuristic = hasattr(base, "prepare") and hasattr(base, "choose")
        self.base: Any = base if is_heuristic else Observing(base)
        self.depth, self.count = check_int("depth", depth, 1), check_int("futures", count, 1)

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """Get ready for ``system``; draws come from ``rng``."""
        self.base.begin(system, num_envs, rng)
        self.system, self._rng = system, rng
        self.is_certain = np.prod(system.outcome_shape) == 0
        self._has_leftover = hasattr(self.base, "leftover")

    def draw(self, envs: int, count: int | None = None) -> Array | None:
        """Uniform draws (depth, env, future, *outcome_shape) of all outcomes; None where no outcome is random."""
        if self.is_certain:
            return None
        return self._rng.random((self.depth, envs, count or self.count, *self.system.outcome_shape))

    def costs(self, belief: Any, plans: Array | None, prepared: Array | None, draws: Array | None) -> Array:
        """Summed cost of each plan in each future.

        Args:
            belief: beliefs, axis 0 = environment.
            plans: first actions, (env, plan, steps, ...); None: the base policy alone, as one plan. Indices below 0, or
                masked where the system is strict, leave the choice to the base.
            prepared: result of the base's ``prepare`` at these beliefs.
            draws: of ``draw``; None: the expected recursion, one future.

        Returns:
            (env, plan, future).
        """
        envs, count = len(belief.step), 1 if plans is None else plans.shape[1]
        futures = 1 if draws is None else draws.shape[2]
        chunk = max(1, ROWS // (count * futures))
        if envs <= chunk:
            return self._followed(belief, plans, prepared, draws).reshape(-1, count, futures)
        parts = []
        for at in range(0, envs, chunk):
            part = slice(at, at + chunk)
            here, its_plans, its_prepared = (
                trees.tree_map(lambda leaf, part=part: leaf[part], each) for each in (belief, plans, prepared)
            )
            parts.append(self.costs(here, its_plans, its_prepared, None if draws is None else draws[:, part]))
        return np.concatenate(parts)

    def nominal(self, belief: Any, plan: Array | None, prepared: Array | None) -> Array:
        """Actions (env, depth, ...) in the expected recursion: of the plan (env, steps, ...), then of the base.

        After the end of an episode its last action is repeated.
        """
        here, actions = belief, []
        for t in range(self.depth):
            mask = allowed(self.system, here)
            action = self.base.choose(here, mask, prepared)
            if plan is not None and t < plan.shape[1]:
                action = possible(plan[:, t], action, mask if self.system.strict else None)
            actions.append(action)
            over = self.system.terminal(here)
            if over.all():
                break
            here = trees.merged(self.system.predict(here, action), over, here)
        actions += [actions[-1]] * (self.depth - len(actions))
        return np.stack(actions, axis=1)

    def _followed(self, belief: Any, plans: Array | None, prepared: Array | None, draws: Array | None) -> Array:
        """Summed costs, flat (env, plan, future)."""
        envs, count = len(belief.step), 1 if plans is None else plans.shape[1]
        futures = 1 if draws is None else draws.shape[2]
        each, steps = count * futures, 0 if plans is None else plans.shape[2]
        live = np.arange(envs * each)  # rows whose episode goes on
        env, future = live // each, live % futures
        here = trees.repeated(belief, each)
        held = None if prepared is None else np.repeat(prepared, each, axis=0)
        total = np.zeros(envs * each)
        for t in range(self.depth):
            over = self.system.terminal(here)
            if over.any():
                live, here = live[~over], trees.take(here, ~over)
                env, future = live // each, live % futures
                held = None if held is None else held[~over]
            if not len(live):
                return total
            action = None if plans is None or t >= steps else plans[env, live // futures % count, t]
            here = self._step(here, action, held, None if draws is None else draws[t, env, future])
            total[live] += self.system.cost(here)
        if self._has_leftover:
            total[live] += np.where(self.system.terminal(here), 0.0, self.base.leftover(here, held))
        return total

    def _step(self, belief: Any, action: Array | None, prepared: Array | None, outcome: Array | None) -> Any:
        if action is None:
            action = self.base.choose(belief, allowed(self.system, belief), prepared)
        elif action.ndim == 1:
            mask = allowed(self.system, belief) if self.system.strict else None
            if (action < 0).any() or (mask is not None and not mask[np.arange(len(action)), action].all()):
                action = possible(action, self.base.choose(belief, allowed(self.system, belief), prepared), mask)
        return self.system.predict(belief, action, outcome)


def possible(wanted: Array, otherwise: Array, mask: Array | None) -> Array:
    """``wanted`` where it is an allowed index, else ``otherwise``."""
    if wanted.ndim > 1:
        return wanted
    can = wanted >= 0
    if mask is not None:
        can &= mask[np.arange(len(wanted)), wanted]
    return np.where(can, wanted, otherwise)


def significant(costs: Array, base: Array, errors: float) -> Array:
    """The plan to take, (env,): -1 for the base, unless a plan's paired gain is significant.

    The plan with the greatest gain less ``errors`` standard errors is taken, if that difference is above 0.

    Args:
        costs: of each plan in each future, (env, plan, future); infinite for a plan that is not allowed.
        base: of the base in the same futures, (env, 1, future).
        errors: standard errors of the mean paired gain.
    """
    gain = base - costs
    futures = gain.shape[2]
    if futures > 1:
        with np.errstate(invalid="ignore"):
            bound = gain.mean(axis=2) - errors * gain.std(axis=2, ddof=1) / np.sqrt(futures)
    else:
        bound = gain[:, :, 0]
    bound = np.where(np.isfinite(bound), bound, -np.inf)
    return np.where(bound.max(axis=1) > 0.0, bound.argmax(axis=1), -1)
