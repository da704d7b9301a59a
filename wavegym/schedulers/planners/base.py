"""The base class of planners: a base policy, sampled futures, and the test for a significant gain."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int, check_non_negative
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.schedulers.heuristics.base import Heuristic
from wavegym.schedulers.rollout import allowed, check_equal_steps

ROWS = 16_384  # beliefs simulated at a time: they fit the processor's cache
FUTURES = 32
ERRORS = 1.0
QUICK = 8  # futures from which on a quarter of them selects the plans to keep
SHORTLIST = 40  # candidates that are simulated: those of least one-step cost


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


class Planner:
    """Plays its base policy, except where a plan's mean paired gain over it is ``errors`` standard errors above 0.

    The gain is estimated in sampled futures; base and plans meet the same outcomes.

    Args:
        base: the policy to improve on. It also chooses after the end of a plan. It is called at simulated beliefs, in
            batches of any size, so it must keep no memory between calls.
        depth: steps of a future.
        futures: number of sampled futures.
        errors: standard errors that a gain must exceed.
        shortlist: number of candidates that are simulated: those of least one-step cost.

    Raises:
        InputError: a number out of range.
    """

    def __init__(
        self,
        base: Policy,
        depth: int = 20,
        futures: int = FUTURES,
        errors: float = ERRORS,
        shortlist: int = SHORTLIST,
    ) -> None:
        self.futures = SampledFutures(base, depth, futures)
        self.errors, self.shortlist = check_non_negative("errors", errors), shortlist

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError where steps differ in length."""
        check_equal_steps(type(self).__name__, system)
        self.futures.begin(system, num_envs, rng)
        self.system, self.candidates, self.rng = system, system.candidates(), rng

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        prepared = self.futures.base.prepare(belief)
        action: Array = self.futures.base.choose(belief, mask, prepared)
        live = ~self.system.terminal(belief)
        if live.any():
            if not live.all():
                belief = trees.take(belief, live)
                prepared = None if prepared is None else prepared[live]
                mask = None if mask is None else mask[live]
            better = self.improved(belief, action[live], mask, prepared, np.flatnonzero(live))
            action = action.astype(np.result_type(action, better))
            action[live] = better
        return action

    def improved(self, belief: Any, own: Array, mask: Array | None, prepared: Array | None, rows: Array) -> Array:
        """Actions (env, ...) for beliefs whose episodes go on.

        Args:
            belief: the beliefs.
            own: the base policy's actions.
            mask: allowed actions, or None.
            prepared: result of the base's ``prepare``.
            rows: indices of these environments in the batch.
        """
        raise NotImplementedError

    def options(self, belief: Any, mask: Array | None) -> tuple[Array, Array]:
        """First actions to simulate, (env, option, ...), and whether each is allowed, (env, option)."""
        envs, count = len(belief.step), len(self.candidates)
        if count <= self.shortlist:
            listed = np.broadcast_to(self.candidates, (envs, *self.candidates.shape))
            return listed, np.ones((envs, count), np.bool_) if mask is None else mask
        costs = self.system.cost(self.system.predict(belief, self.candidates[None]))
        if mask is not None:
            costs = np.where(mask, costs, np.inf)
        best = np.argsort(costs, axis=1, kind="stable")[:, : self.shortlist]
        return self.candidates[best], np.isfinite(np.take_along_axis(costs, best, axis=1))

    def chosen(
        self, belief: Any, own: Array, plans: Array, permitted: Array, prepared: Array | None, few: int = 0
    ) -> Array:
        """First actions of the plans that beat the base significantly, or the base's own, (env, ...).

        Args:
            belief, own, prepared: see ``improved``.
            plans: (env, plan, steps, ...).
            permitted: whether each plan is allowed, (env, plan).
            few: if not 0, only the ``few`` best plans of the first quarter of the futures are simulated in all of them.
        """
        draws = self.futures.draw(len(belief.step))
        futures = 1 if draws is None else draws.shape[2]
        if few and draws is not None and futures >= QUICK and plans.shape[1] > few:
            quick = self.futures.costs(belief, plans, prepared, draws[:, :, : futures // 4]).mean(axis=2)
            best = np.argsort(np.where(permitted, quick, np.inf), axis=1, kind="stable")[:, :few]
            at = np.arange(len(best))[:, None]
            plans, permitted = plans[at, best], permitted[at, best]
        base, costs = self._beside_base(belief, plans, prepared, draws)
        taken = significant(np.where(permitted[:, :, None], costs, np.inf), base, self.errors)
        first = plans[np.arange(len(taken)), np.maximum(taken, 0), 0]
        shape = (-1,) + (1,) * (first.ndim - 1)
        return np.where((taken >= 0).reshape(shape), first, own)

    def _beside_base(
        self, belief: Any, plans: Array, prepared: Array | None, draws: Array | None
    ) -> tuple[Array, Array]:
        """Costs of the base, (env, 1, future), and of the plans, (env, plan, future), with the same outcomes."""
        if plans.ndim > 3:
            return self.futures.costs(belief, None, prepared, draws), self.futures.costs(belief, plans, prepared, draws)
        nothing = np.full((len(plans), 1, plans.shape[2]), -1)
        together = self.futures.costs(belief, np.concatenate([nothing, plans], axis=1), prepared, draws)
        return together[:, :1], together[:, 1:]
