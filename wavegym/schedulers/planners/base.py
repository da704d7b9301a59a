"""The base class of planners: a base policy, sampled futures, and the test for a significant gain."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import check_non_negative
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.schedulers.planners.sampled_futures import SampledFutures, significant
from wavegym.schedulers.rollout import check_equal_steps

FUTURES = 32
ERRORS = 1.0
QUICK = 8  # futures from which on a quarter of them selects the plans to keep
SHORTLIST = 40  # candidates that are simulated: those of least one-step cost


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
