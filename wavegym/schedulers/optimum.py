"""The best schedule of a whole episode if the covariance is deterministic: a reference for all schedulers.

The method is a forward search over the tree of schedules, step by step. Most of the beliefs after k steps are
dominated: another belief costs less and has a smaller covariance. Let J_a(P) be the cost of continuing from covariance
P with the actions a. The search drops A = (c_A, P_A) for B = (c_B, P_B) where, for some e >= 0,

    P_B <= (1 + e) P_A  (Loewner order)   and   c_B + e (U - c_A - h) <= c_A + d.

U is the cost of a schedule already found, h a bound from below on the cost of the remaining steps, d an allowance.

*Proof.* One step of the Riccati recursion, f(P) = F P F' + Q updated with R, is the least of (I - L M)(F P F' + Q)(I -
L M)' + L R L' over all gains L. So it is monotone and concave in P with f(0) >= 0. Any composition of such steps has
this property, and so has J_a, a sum of their weighted traces. Concavity on the ray through P_A gives J_a(P_B) <= J_a((1
+ e) P_A) <= J_a(P_A) + e (J_a(P_A) - J_a(0)). Let a be the best way to continue A, and V = c + min_a J_a(P) the cost of
a belief's best schedule. If V_A < U then J_a(P_A) < U - c_A, and J_a(0) >= h, so V_B <= c_B + J_a(P_A) + e (U - c_A -
h) <= V_A + d. If V_A >= U nothing is lost, as the schedule of cost U is known. The same holds if a belief with c + h >=
U is dropped. So the least of U and the V of all beliefs kept grows by at most d from step to step, and the schedule
found costs at most H d more than the optimum. With d = 0 it is the optimum. Beliefs dropped because ``nodes`` are kept
already have V >= c + h, which enters the bound.

h is the sum, over the remaining steps, of the least cost that any schedule of the last few steps can make of a zero
covariance (monotonicity again); U comes from the same search with few nodes. Two states, 50 steps and 56 or 88
waveforms take 10 to 50 ms.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_non_negative, check_positive
from wavegym.core.shortcuts import Recursion, deterministic_recursion
from wavegym.core.system import System
from wavegym.schedulers.myopic import require

BEAM, BEAM_SLACK = 20, 0.03  # of the first schedule's search: nodes kept, and slack of the dominance


class Schedule(NamedTuple):
    """The best schedule of each environment."""

    actions: Array  # (env, H) int, indices of candidates
    cost: Array  # (env,) sum over the steps
    lower_bound: Array  # (env,) no schedule costs less, except for rounding


def best_schedule(recursion: Recursion, tolerance: float = 0.0, nodes: int = 10_000) -> Schedule:
    """The cheapest schedule of each environment, with a certificate (the module's docstring has the proof).

    Args:
        recursion: model, and measurement covariances of all steps.
        tolerance: how much the cost may exceed the optimum, relative to that of a first schedule (about 1 % above the
            optimum); 0 is exact.
        nodes: beliefs kept per step, which bounds the memory (about 100 bytes per belief and waveform). Where they do
            not suffice, as may happen with three states, ``lower_bound`` bounds the loss of the schedule.

    Raises:
        InputError: a tolerance that is negative or not finite, no nodes.
    """
    from wavegym.schedulers import optimum_kernels as kernels

    check_non_negative("tolerance", tolerance)
    limit = int(check_positive("nodes", nodes))
    P0, F, Q, M, R, weights = (np.array(a, np.float64, order="C") for a in recursion)
    model, sizes = kernels.Model(F[None], Q[None], M[None], weights), ((0,) * len(F), (0,) * len(M))
    count, horizon, candidates = R.shape[:3]
    room = kernels.make_nodes(limit, sizes[0]), kernels.make_nodes(limit * candidates + 1, sizes[0])
    origins, free = np.empty((horizon, limit), np.int64), np.zeros(horizon)
    actions, cost, bound = np.zeros((count, horizon), np.int64), np.empty(count), np.empty(count)
    for e in range(count):
        known, tools = (P0[e], model, R[e]), (*room, origins, actions[e], *sizes)
        ceiling, _ = kernels.search(*known, BEAM_SLACK, 0.0, free, np.inf, min(BEAM, limit), *tools)
        rest = kernels.cost_to_come(model, R[e], *room, *sizes)
        allowance = tolerance * ceiling / len(free)
        cost[e], lost = kernels.search(*known, 0.0, allowance, rest, ceiling, limit, *tools)
        bound[e] = min(cost[e], lost) - tolerance * ceiling
    return Schedule(actions, cost, bound)


class Optimum:
    """Plays the best schedule. Clairvoyant: it knows the target's future range, hence the SNR of every future step.

    For systems that have ``deterministic_recursion``. ``plan`` holds the schedule, its cost and the bound.

    Args:
        tolerance, nodes: see ``best_schedule``.
        gap: largest relative gap between cost and lower bound of a plan that counts as the optimum.
    """

    plan: Schedule

    def __init__(self, tolerance: float = 0.0, nodes: int = 10_000, gap: float = 1e-3) -> None:
        self.tolerance, self.nodes, self.gap = tolerance, nodes, gap

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError where the system's covariance is not deterministic."""
        require("optimum", system, deterministic_recursion)
        self._system: Any = system
        self._candidates = system.candidates()

    def reveal(self, world: Any) -> None:
        """Plan for the worlds (axis 0 = environment) that will be played; called once after ``begin``.

        Raises an InputError where ``nodes`` do not suffice to certify a plan as the optimum.
        """
        self.plan = best_schedule(deterministic_recursion(self._system, world), self.tolerance, self.nodes)
        gaps = 1.0 - self.plan.lower_bound / self.plan.cost
        if gaps.max() > self.gap:
            found = f"{np.count_nonzero(gaps > self.gap)} of {len(gaps)} plans are certified to {gaps.max():.2g} only"
            raise InputError(f"policy 'optimum': {found}, expected {self.gap:g} with more nodes than {self.nodes}")

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``. After the end of an episode the action is arbitrary. Raises an InputError for a mask."""
        if mask is not None:
            raise InputError("policy 'optimum' was given a mask, expected a system without masks")
        step = np.minimum(belief.step, self.plan.actions.shape[1] - 1)
        return self._candidates[self.plan.actions[np.arange(len(step)), step]]
