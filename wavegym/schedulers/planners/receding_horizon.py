"""Plans improved by local search, at every step or once.

Where actions are paid from one account, pairs of changes are tried, of which one pays for the other.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int
from wavegym.core.policy import Policy
from wavegym.core.shortcuts import spending
from wavegym.core.system import System
from wavegym.schedulers.heuristics.price_policies import ample
from wavegym.schedulers.planners.base import Planner, SampledFutures, possible

FAR, NEAR = 200, 300  # pairs of changes that are simulated: of any two steps, of two close steps
CLOSE = 3  # steps
MERGED = 100  # greatest number of pairs that are made together
ROUND = 1e-9  # of the account
MOVES = 32  # neighbours of a plan that are tried in one round


def exchanged(
    futures: SampledFutures,
    belief: Any,
    plan: Array,
    options: Array,
    prepared: Array | None,
    draws: Array | None,
    rounds: int,
) -> Array:
    """Plans (env, depth) improved by exchanging energy between steps, one environment after the other.

    Every round simulates each change of one step with an account that never empties. The most promising pairs of
    changes that stay within the account are then simulated with the real account. All pairs that save cost and are
    apart from each other are made at once. The search ends when no pair saves cost.

    Args:
        futures: simulate the plans.
        belief: beliefs, axis 0 = environment.
        plan: actions to begin with, (env, depth).
        options: actions to choose from, (env, option).
        prepared: result of the base's ``prepare``.
        draws: of ``SampledFutures.draw``; None: the expected recursion.
        rounds: greatest number of rounds.
    """
    found = plan.copy()
    for env in range(len(plan)):
        at = slice(env, env + 1)
        one = trees.take(belief, np.array([env]))
        own, drawn = None if prepared is None else prepared[at], None if draws is None else draws[:, at]
        found[env] = _exchanged_one(futures, one, plan[env], options[env], own, drawn, rounds)
    return found


def _exchanged_one(
    futures: SampledFutures,
    belief: Any,
    plan: Array,
    options: Array,
    prepared: Array | None,
    draws: Array | None,
    rounds: int,
) -> Array:
    """``exchanged`` of one environment: ``belief`` (1,), ``plan`` (depth,), ``options`` (option,)."""
    system: Any = futures.system
    steps = min(system.horizon - int(belief.step[0]), len(plan))
    rich = ample(system, belief)

    def judged(purse: Any, plans: Array) -> Array:
        costs: Array = futures.costs(purse, plans[None], prepared, draws)[0].mean(axis=1)
        return costs

    for _ in range(rounds):
        single = _Singles(plan, options, steps, spending(system))
        single.judge(partial(judged, rich))
        better = _traded(single, partial(judged, belief), float(belief.energy[0]))
        if better is None:
            break
        plan = better
    return plan


class _Singles:
    """Changes of one step of a plan (depth,): the step, the new action, the energy paid and the cost added.

    The first entry is no change. Of changes at one step with the same energy only the best is kept.
    """

    def __init__(self, plan: Array, options: Array, steps: int, spending: Array) -> None:
        at, to = (a.ravel() for a in np.meshgrid(np.arange(steps), options, indexing="ij"))
        is_new = to != plan[at]
        self.plan, self.spent = plan, float(spending[plan[:steps]].sum())
        self.at, self.to = np.append(-1, at[is_new]), np.append(plan[-1], to[is_new])
        self.paid = np.append(0.0, (spending[to] - spending[plan[at]])[is_new])

    def judge(self, costs: Callable[[Array], Array]) -> None:
        """Find the cost that each change adds, and drop the changes that another one dominates."""
        values = costs(self.made(np.arange(len(self.at))[:, None]))
        self.added = values - values[0]
        order = np.lexsort((self.added, self.paid, self.at))
        is_first = np.append(True, (np.diff(self.at[order]) != 0) | (np.diff(self.paid[order]) != 0))
        best = order[is_first]
        self.at, self.to, self.paid, self.added = (a[best] for a in (self.at, self.to, self.paid, self.added))

    def made(self, changes: Array) -> Array:
        """The plan after changes (plan, change): (plan, depth). Later changes of a row overwrite earlier ones."""
        plans = np.repeat(self.plan[None], len(changes), axis=0)
        for column in changes.T:
            plans[np.arange(len(plans)), self.at[column]] = self.to[column]
        return plans


def _traded(single: _Singles, judge: Callable[[Array], Array], energy: float) -> Array | None:
    """The plan after the pairs of changes that save most, or None if no pair saves cost."""
    slack = energy - single.spent + ROUND
    pairs = _promising(single, slack)
    values = judge(np.concatenate([single.plan[None], single.made(pairs)]))
    saved = values[1:] - values[0]
    order = np.argsort(saved, kind="stable")[:MERGED]
    taken: list[int] = []
    touched = np.zeros(len(single.plan), np.bool_)
    for pair in pairs[order[saved[order] < 0.0]]:
        steps = single.at[pair][single.at[pair] >= 0]
        paid = float(single.paid[[*taken, *pair]].sum())
        if paid <= slack and not touched[steps].any():
            taken += pair.tolist()
            for step in steps:
                touched[max(step - CLOSE, 0) : step + CLOSE + 1] = True
    if not taken:
        return None
    growing = np.zeros((len(taken) // 2, len(taken)), np.int64)  # the first pair, the first two, ...; 0: no change
    for row in range(len(growing)):
        growing[row, : 2 * row + 2] = taken[: 2 * row + 2]
    # "No change" writes the last step's old action, so it comes first: a change of that step must overwrite it.
    plans = single.made(np.sort(growing, axis=1))
    costs = judge(plans)
    best = int(costs.argmin())
    return plans[best] if costs[best] < values[0] else None


def _promising(single: _Singles, slack: float) -> Array:
    """Pairs of changes (pair, 2), the earlier step first, that fit the account; those of least summed added cost."""
    first, second = single.at[:, None], single.at
    fits = (first < second) & (single.paid[:, None] + single.paid <= slack)
    promised = np.where(fits, single.added[:, None] + single.added, np.inf)
    is_close = (second - first <= CLOSE) & (first >= 0)
    best = np.union1d(_least(promised, FAR), _least(np.where(is_close, promised, np.inf), NEAR))
    return np.stack(np.unravel_index(best, promised.shape), axis=1)


def _least(values: Array, count: int) -> Array:
    """Flat indices of the ``count`` least values, finite ones only."""
    flat = values.ravel()
    best = np.argpartition(flat, count - 1)[:count] if count < len(flat) else np.arange(len(flat))
    return best[np.isfinite(flat[best])]


def neighbours(plan: Array, options: Array, steps: Array, moves: int, rng: np.random.Generator) -> Array:
    """Plans that differ from ``plan`` by one or two moves.

    A move sets a run of steps to one action, exchanges two steps, or shifts the actions between two steps by one.

    Args:
        plan: (env, depth, ...).
        options: actions to choose from, (env, option, ...).
        steps: number of steps that the plan is made for, (env,).
        moves: number of neighbours.
        rng: the source of the moves.

    Returns:
        (env, moves, depth, ...).
    """
    once = _moved(np.repeat(plan[:, None], moves, axis=1), options, steps, rng)
    twice = _moved(once, options, steps, rng)
    return np.where(_as(rng.random(once.shape[:2]) < 0.5, once), once, twice)


def _moved(plans: Array, options: Array, steps: Array, rng: np.random.Generator) -> Array:
    """``plans`` (env, move, depth, ...), each after one move."""
    shape, depth = plans.shape[:2], plans.shape[2]
    limit = np.minimum(steps, depth)[:, None]
    a, b = (np.minimum((rng.random(shape) * limit).astype(np.int64), limit - 1) for _ in range(2))
    run, kind = rng.geometric(0.4, shape), rng.integers(3, size=shape)[..., None]
    at = np.broadcast_to(np.arange(depth), (*shape, depth))
    first, second = a[..., None], b[..., None]
    low, high = np.minimum(first, second), np.maximum(first, second)
    swapped = np.where(at == first, second, np.where(at == second, first, at))
    later = np.where(
        (at > low) & (at <= high), at - 1, at
    )  # the action at low lasts a step longer, that at high is dropped
    sooner = np.where((at >= low) & (at < high), at + 1, at)
    order = np.where(kind == 1, swapped, np.where(kind == 2, np.where(first < second, later, sooner), at))
    rows = np.arange(len(plans))[:, None]
    found: Array = plans[rows[..., None], np.arange(shape[1])[:, None], order]
    put = options[rows, (rng.random(shape) * options.shape[1]).astype(np.int64)]
    is_put = (kind == 0) & (at >= first) & (at < first + run[..., None])
    return np.where(_as(is_put, found), put[:, :, None], found)


def searched(
    futures: SampledFutures, belief: Any, plan: Array, options: Array, prepared: Array | None, draws: Array | None,
    rounds: int, rng: np.random.Generator,
) -> Array:  # fmt: skip
    """The plan (env, depth, ...) after a local search.

    In every round the best of ``MOVES`` neighbours is taken if it costs less. Where actions are paid from an account,
    ``exchanged`` comes first: random changes rarely both fit the account and save cost.
    """
    if spending.of(futures.system):
        plan = exchanged(futures, belief, plan, options, prepared, draws, rounds)
    steps = np.maximum(futures.system.horizon - belief.step, 1)
    rows = np.arange(len(plan))
    cost = futures.costs(belief, plan[:, None], prepared, draws)[:, 0].mean(axis=1)
    for _ in range(rounds):
        tried = neighbours(plan, options, steps, MOVES, rng)
        values = futures.costs(belief, tried, prepared, draws).mean(axis=2)
        best = values.argmin(axis=1)
        is_less = values[rows, best] < cost
        cost = np.where(is_less, values[rows, best], cost)
        plan = np.where(_as(is_less, plan), tried[rows, best], plan)
    return plan


class RecedingHorizon(Planner):
    """Receding-horizon planning: a whole plan is kept, shifted and improved by local search at every step.

    Open-loop feedback control: the plan ignores future measurements and is improved after each one. It is made for the
    expected recursion, or for ``sampled`` futures.

    Args:
        base, depth, futures, errors: see ``Planner``.
        rounds: of the local search at every step.
        first: rounds for the first plan of an episode.
        sampled: futures that a plan is made for; 0 for the expected recursion.
        asks: whether the plan has to beat the base in sampled futures. These favour the base, because it reacts to
            outcomes and the plan does not. With few affordable actions they reject good plans.
    """

    def __init__(
        self,
        base: Policy,
        depth: int = 20,
        rounds: int = 4,
        first: int = 20,
        sampled: int = 0,
        asks: bool = True,
        **settings: Any,
    ) -> None:
        super().__init__(base, depth, **settings)
        self.rounds, self.first, self.sampled = check_int("rounds", rounds, 0), check_int("first", first, 0), sampled
        self.asks = asks

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        super().begin(system, num_envs, rng)
        self._plan: Array | None = None
        self._made = np.full(num_envs, -2)  # the step at which each plan begins

    def improved(self, belief: Any, own: Array, mask: Array | None, prepared: Array | None, rows: Array) -> Array:
        """See ``Planner``."""
        options, _ = self.options(belief, mask)
        draws = self.futures.draw(len(rows), self.sampled) if self.sampled else None
        plan = self.futures.nominal(belief, None, prepared)
        is_old = self._made[rows] == belief.step - 1
        if self._plan is not None and is_old.any():
            kept = self.futures.nominal(belief, np.where(_as(is_old, plan), self._plan[rows], plan)[:, 1:], prepared)
            pair = self.futures.costs(belief, np.stack([plan, kept], axis=1), prepared, draws).mean(axis=2)
            plan = np.where(_as(is_old & (pair[:, 1] <= pair[:, 0]), plan), kept, plan)
        plan = searched(self.futures, belief, plan, options, prepared, draws, self.rounds, self.rng)
        if not is_old.all() and self.first > self.rounds:
            fresh = ~is_old
            part = trees.take(belief, fresh)
            some = None if prepared is None else prepared[fresh]
            drawn = None if draws is None else draws[:, fresh]
            more = self.first - self.rounds
            plan[fresh] = searched(self.futures, part, plan[fresh], options[fresh], some, drawn, more, self.rng)
        if self._plan is None:
            self._plan = np.zeros((len(self._made), *plan.shape[1:]), plan.dtype)
        self._plan[rows], self._made[rows] = plan, belief.step
        may = np.ones((len(rows), 1), np.bool_)
        if mask is not None and plan.ndim == 2:
            may = np.take_along_axis(mask, plan[:, :1], axis=1)
        if not self.asks:
            return np.where(_as(may[:, 0], own), plan[:, 0], own)
        return self.chosen(belief, own, plan[:, None], may, prepared)


class PlanOnce:
    """A plan of the whole episode, made at its first step for the expected recursion, then played unchanged.

    Args:
        base: the local search starts from its sequence of actions; it also chooses where an action is masked.
        rounds: of the local search.
    """

    def __init__(self, base: Policy, rounds: int = 200) -> None:
        self._base, self.rounds = base, check_int("rounds", rounds, 0)

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        self._planner = Planner(self._base, system.horizon)
        self._planner.begin(system, num_envs, rng)
        self._system, self._rng = system, rng
        self._plan: Array | None = None

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``."""
        fresh = np.flatnonzero(belief.step == 0) if self._plan is not None else np.arange(len(belief.step))
        if len(fresh):
            plan = self._planned(trees.take(belief, fresh), None if mask is None else mask[fresh])
            if self._plan is None:
                self._plan = plan
            else:
                self._plan[fresh] = plan
        assert self._plan is not None
        at = np.minimum(belief.step, self._plan.shape[1] - 1)
        wanted: Array = self._plan[np.arange(len(at)), at]
        if mask is None or not self._system.strict or wanted.ndim > 1:
            return wanted
        base = self._planner.futures.base
        return possible(wanted, base.choose(belief, mask, base.prepare(belief)), mask)

    def _planned(self, belief: Any, mask: Array | None) -> Array:
        """Plans (env, horizon, ...) indexed by step; before its first step a plan holds its first action."""
        planner, futures = self._planner, self._planner.futures
        prepared = futures.base.prepare(belief)
        plan = futures.nominal(belief, None, prepared)
        options, _ = planner.options(belief, mask)
        found = searched(futures, belief, plan, options, prepared, None, self.rounds, self._rng)
        late = np.maximum(np.arange(self._system.horizon) - belief.step[:, None], 0)
        return found[np.arange(len(found))[:, None], late]


def _as(flags: Array, like: Array) -> Array:
    """``flags`` with as many axes as ``like``."""
    return flags.reshape(*flags.shape, *(1,) * (like.ndim - flags.ndim))
