"""Compares every capability of a system with the generic functions of the contract, along random episodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.capabilities import (
    CAPABILITIES,
    BestAction,
    BestSequence,
    Capability,
    DecisionMakers,
    Delay,
    DeterministicRecursion,
    FusedTransition,
    Gain,
    LinearCost,
    MostInformation,
    SensorBySensor,
    SequencePlan,
    Spending,
    delays,
    offers,
    why_not,
    withdrawn,
)
from wavegym.core.costs import trace_cost
from wavegym.core.decision_makers import makers_by_form
from wavegym.core.parameter_box import ParameterBox
from wavegym.core.system import System
from wavegym.schedulers.lookahead import Lookahead

WORLDS = 3
STEPS = (0, 1, 4)  # of the episodes, at which beliefs are sampled
FEW = 64  # candidates compared one by one
EXACT = 1e-6  # relative to the cost: rounding of the same sum in another order
NEARLY = 0.1  # relative: a local search, such as sensor by sensor, may miss the best candidate by this much

Check = Callable[[Any, Any, Array], str | None]  # (system, belief, some candidates) -> defect


def capability_defect(system: System, seed: int = 0) -> str | None:
    """The first capability that is declared wrongly or disagrees with the generic functions; None where all agree."""
    defect = _declaration_defect(system)
    if defect:
        return defect
    candidates = system.candidates()
    candidates = candidates[:: -(-len(candidates) // FEW)]
    for state, world in _episodes(system, candidates, seed):
        for kind, check in CHECKS.items():
            if offers(system, kind):
                try:
                    defect = check(system, state.belief, candidates)
                except NotImplementedError:
                    continue  # the capability is not for this form of the action set
                if defect:
                    return f"{kind.__name__} at step {int(state.belief.step[0])}: {defect}"
        if offers(system, FusedTransition):
            with suppress(NotImplementedError):  # a tracker that has the compiled step alone
                defect = _fused(system, state, world, candidates)
            if defect:
                return f"FusedTransition at step {int(state.belief.step[0])}: {defect}"
        if offers(system, DeterministicRecursion):
            with suppress(NotImplementedError):  # not with another tracker
                defect = _recursion(system, world)
            if defect:
                return f"DeterministicRecursion: {defect}"
    return None


def _declaration_defect(system: System) -> str | None:
    """A capability that is stale below an override, or that exists but is not declared."""
    declared = {member for kind in CAPABILITIES if isinstance(system, kind) for member in kind.members}
    for kind in CAPABILITIES:
        named = set(kind.members) & getattr(kind, "__abstractmethods__", frozenset())
        undeclared = any(hasattr(system, member) for member in named - declared)
        if undeclared or (isinstance(system, kind) and not withdrawn(system, kind) and not offers(system, kind)):
            return f"{kind.__name__}: {why_not(system, kind)}"
    return None


def _episodes(system: System, candidates: Array, seed: int) -> Iterator[tuple[Any, Any]]:
    """States of a batch of worlds at ``STEPS``, reached by random candidates, and the worlds; up to an early end."""
    rng = np.random.default_rng(seed)
    world = trees.stack([system.draw_world(np.random.default_rng([seed, i])) for i in range(WORLDS)])
    state = system.initial(world)
    for step in range(min(max(STEPS), system.horizon - 1) + 1):
        if system.terminal(state.belief).any():
            return
        if step in STEPS:
            yield state, world
        mask = system.mask(state.belief) if candidates.ndim == 1 and candidates.dtype.kind in "iu" else None
        if mask is None:
            action = candidates[rng.integers(len(candidates), size=WORLDS)]
        else:
            action = np.array([rng.choice(np.flatnonzero(row)) for row in mask])
        state = system.transition(state, action, world)


def _costs(system: Any, belief: Any, candidates: Array) -> Array:
    """The predicted cost of each candidate, (env, candidate)."""
    return np.asarray(system.cost(system.predict(belief, candidates[None])))


def _differ(got: Array, want: Array, scale: Array, tolerance: float = EXACT) -> bool:
    """Whether two arrays (env, ...) differ by more than a share of ``scale`` (env,)."""
    wide = np.abs(scale).reshape(-1, *[1] * (np.ndim(got) - 1))
    return bool((np.abs(got - want) > tolerance * wide).any())


def _best_action(system: Any, belief: Any, candidates: Array) -> str | None:
    best = np.asarray(system.best_action(belief))
    shape = (WORLDS, *candidates.shape[1:])
    if best.shape != shape:
        return f"best_action() returned shape {best.shape}, expected {shape}"
    cost, others = system.cost(system.predict(belief, best)), _costs(system, belief, candidates).min(axis=1)
    if (cost > others + NEARLY * np.abs(others)).any():
        return f"best_action() costs {cost.tolist()}, but candidates cost {others.tolist()}"
    return None


def _best_sequence(system: Any, belief: Any, candidates: Array) -> str | None:
    depth = 2 if len(system.candidates()) <= FEW * 2 else 1
    first, cost = system.best_sequence(belief, depth)
    search = Lookahead(depth, fused=False)
    search.begin(system, WORLDS, np.random.default_rng(0))
    values = search.values(belief)
    least = values.min(axis=1)
    if _differ(cost, least, least) or _differ(values[np.arange(WORLDS), first], least, least):
        return f"best_sequence(depth {depth}) costs {cost.tolist()}, but the best of all costs {least.tolist()}"
    return None


def _plan(system: Any, belief: Any, candidates: Array) -> str | None:
    first, cost = system.plan(belief, 1)
    own, others = system.cost(system.predict(belief, first)), _costs(system, belief, candidates).min(axis=1)
    if _differ(cost, own, own):
        return f"plan(depth 1) says {cost.tolist()}, but its actions cost {own.tolist()}"
    if (own > others + NEARLY * np.abs(others)).any():
        return f"plan(depth 1) costs {own.tolist()}, but candidates cost {others.tolist()}"
    return None


def _linear_cost(system: Any, belief: Any, candidates: Array) -> str | None:
    predicted = system.predict(belief, candidates[None])
    if "covariance" not in getattr(predicted, "_fields", ()):
        return None
    cost = system.cost(predicted)
    P = predicted.covariance
    trace = trace_cost(P.reshape(*cost.shape, -1, *P.shape[-2:]), np.asarray(system.weights))
    if _differ(cost - cost[:, :1], trace - trace[:, :1], np.abs(trace).max(axis=1)):
        return "cost() and trace(Lambda P) of two candidates differ by different amounts"
    return None


def _gain(system: Any, belief: Any, candidates: Array) -> str | None:
    everything = system.candidates()
    gain = np.asarray(system.gain(belief, 0, 1))
    if gain.shape != (WORLDS, len(everything)):
        return f"gain() returned shape {gain.shape}, expected {(WORLDS, len(everything))}"
    cost, ready = _costs(system, belief, everything), (delays(system, belief) == 0) & system.mask(belief)
    for env in range(WORLDS):
        now = np.flatnonzero(ready[env])
        if len(now):
            total = gain[env, now] + cost[env, now]  # the cost without a measurement, equal for all candidates
            if np.ptp(total) > EXACT * np.abs(cost[env]).max():
                return f"gain() of one step and the predicted cost add up to {total.min():.9g} ... {total.max():.9g}"
    return None


def _delay(system: Any, belief: Any, candidates: Array) -> str | None:
    delay, shape = np.asarray(system.delay(belief)), (WORLDS, len(system.candidates()))
    if delay.shape != shape or delay.dtype.kind not in "iu":
        return f"delay() returned shape {delay.shape} of {delay.dtype}, expected {shape} of integers"
    return "delay() is negative" if (delay < 0).any() else None


def _spending(system: Any, belief: Any, candidates: Array) -> str | None:
    spending, shape = np.asarray(system.spending), (len(system.candidates()),)
    if spending.shape != shape or (spending < 0).any():
        return f"spending has shape {spending.shape} and the least value {spending.min()}, expected {shape}, none < 0"
    return None if "energy" in belief._fields else "the belief has no field energy, the account for spending"


def _most_information(system: Any, belief: Any, candidates: Array) -> str | None:
    actions, feasible = system.most_information(belief)
    least = system.information(belief, actions).min(axis=1)
    short = least < system.threshold * (1.0 - EXACT)
    if (short & feasible).any():
        return f"most_information() gives {least.tolist()}, less than the threshold {system.threshold:g}"
    return None


def _sensor_by_sensor(system: Any, belief: Any, candidates: Array) -> str | None:
    sent, predicted = system.action_set, system.predicted_targets(belief)
    C = sent.unit_covariance(candidates[:1])  # (1, sensor, 2, 2)
    rows, windows = sent.windows(candidates[:1])
    windows = windows[rows]
    want = _costs(system, belief, candidates[:1])[:, 0]
    *others, last = range(C.shape[1])
    for sensor in others:
        each = (np.repeat(a[:, sensor], WORLDS, axis=0) for a in (C, windows))
        predicted = system.after_sensor(predicted, sensor, *each)
    got = system.sensor_costs(predicted, last, C[None, :, last], windows[None, :, last])[:, 0]
    return f"sensor by sensor costs {got.tolist()}, predict() {want.tolist()}" if _differ(got, want, want) else None


def _decision_makers(system: Any, belief: Any, candidates: Array) -> str | None:
    """Names, observation fields and parameters: each of one decision maker at most, and every parameter of one."""
    makers, actions = system.decision_makers, system.actions
    parameters = actions.names if isinstance(actions, ParameterBox) else ()
    known = {
        "names": (tuple(maker.name for maker in makers), None),
        "fields": (
            tuple(name for maker in makers for name in maker.fields),
            {e.name for e in system.observation_fields},
        ),
        "parameters": (tuple(name for maker in makers for name in maker.parameters), set(parameters)),
    }
    for what, (given, allowed) in known.items():
        if len(set(given)) < len(given):
            return f"decision_makers share {what}: {given}"
        if allowed is not None and not set(given) <= allowed:
            return f"decision_makers have {what} that the system lacks: {sorted(set(given) - allowed)}"
    left = sorted(set(parameters) - set(known["parameters"][0]))
    if left:
        return f"decision_makers leave out the parameters {left}"
    count = len(makers_by_form(actions))
    if not parameters and len(makers) != count:
        return f"decision_makers are {len(makers)}, but the action set is for {count}"
    return None


def _fused(system: Any, state: Any, world: Any, candidates: Array) -> str | None:
    """The compiled step against the sequence of its parts, leaf by leaf."""
    action = np.repeat(candidates[-1:], WORLDS, axis=0)
    whole, parts = (step(state, action, world) for step in (system.fused_transition, system.composed_transition))
    for half, got, want in (("truth", whole.truth, parts.truth), ("belief", whole.belief, parts.belief)):
        for name, value in want._asdict().items():
            if isinstance(value, np.ndarray) and not np.allclose(getattr(got, name), value, EXACT, 0.0, equal_nan=True):
                return f"{name} of the {half} differs from that of move(), measure(), track() and note()"
    return None


def _recursion(system: Any, world: Any) -> str | None:
    """Two steps of the recursion against ``transition`` and ``cost``."""
    found, state, candidates = system.deterministic_recursion(world), system.initial(world), system.candidates()
    P = np.array(found.covariance)
    for step, index in enumerate((0, len(candidates) - 1)):
        state = system.transition(state, np.repeat(candidates[[index]], WORLDS, axis=0), world)
        ahead = found.F @ P @ found.F.T + found.Q
        S = found.M @ ahead @ found.M.T + found.R[:, step, index]
        P = ahead - ahead @ found.M.T @ np.linalg.solve(S, found.M @ ahead)
        cost = np.diagonal(P, axis1=1, axis2=2) @ found.weights
        want = system.cost(state.belief)
        if _differ(cost, want, want):
            return f"step {step + 1} costs {cost.tolist()}, but transition() leads to {want.tolist()}"
    return None


CHECKS: dict[type[Capability], Check] = {
    BestAction: _best_action,
    BestSequence: _best_sequence,
    SequencePlan: _plan,
    LinearCost: _linear_cost,
    Gain: _gain,
    Delay: _delay,
    Spending: _spending,
    MostInformation: _most_information,
    SensorBySensor: _sensor_by_sensor,
    DecisionMakers: _decision_makers,
}
