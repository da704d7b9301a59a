"""Compares every shortcut of a system with the generic functions of the contract, along random episodes."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from wavegym.core import shortcuts, trees
from wavegym.core.action_sets import ParameterBox
from wavegym.core.arrays import Array
from wavegym.core.covariances import trace_cost
from wavegym.core.errors import InputWarning
from wavegym.core.parameters import parameter_infos
from wavegym.core.policy import makers_by_form
from wavegym.core.shortcuts import KINDS
from wavegym.core.system import System
from wavegym.core.traits import TRAITS, DecisionMakers, DwellRule, lacks_trait
from wavegym.schedulers.lookahead import Lookahead

WORLDS = 3
STEPS = (0, 1, 4)  # of the episodes, at which beliefs are sampled
FEW = 64  # candidates compared one by one
EXACT = 1e-6  # relative to the cost: rounding of the same sum in another order
NEARLY = 0.1  # relative: a local search, such as sensor by sensor, may miss the best candidate by this much


class Sample(NamedTuple):
    """The input of a check: a state of a batch of episodes, their worlds, and some candidates (few, ...)."""

    state: Any
    world: Any
    candidates: Array

    @property
    def belief(self) -> Any:
        """The belief of the state."""
        return self.state.belief


Check = Callable[[Any, Sample], str | None]  # (system, sample) -> defect


def shortcut_defect(system: System, seed: int = 0) -> str | None:
    """The first shortcut or trait that is declared wrongly or disagrees with the generic functions; None if all agree.

    A kind that somebody else has declared is checked where ``CHECKS`` has a function for it. Otherwise an InputWarning
    names it.
    """
    defect = _declaration_defect(system)
    if defect:
        return defect
    candidates = system.candidates()
    candidates = candidates[:: -(-len(candidates) // FEW)]
    offered = [name for name, kind in KINDS.items() if not kind.why_not(system)]
    checks = {name: check for name, check in CHECKS.items() if name in offered}
    for name in offered:
        if name not in checks:
            wanted = f"a function wavegym.testing.shortcut_check.CHECKS[{name!r}]"
            warnings.warn(
                f"{name} of {type(system).__name__} is not checked, expected {wanted}", InputWarning, stacklevel=2
            )
    if isinstance(system, DecisionMakers):
        checks["DecisionMakers"] = _decision_makers
    for state, world in _episodes(system, candidates, seed):
        for name, check in checks.items():
            try:
                defect = check(system, Sample(state, world, candidates))
            except NotImplementedError:
                continue  # the shortcut is not for this form of the action set, or not for this tracker
            if defect:
                return f"{name} at step {int(state.belief.step[0])}: {defect}"
    return None


def _declaration_defect(system: System) -> str | None:
    """A shortcut that exists but is not registered, or a trait from which the system does not derive."""
    found = {kind.name: kind.why_not(system) for kind in KINDS.values()}
    found |= {trait.__name__: lacks_trait(system, trait) for trait in TRAITS}
    return next((f"{name}: {why}" for name, why in found.items() if "expected" in why), None)


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


def _best_action(system: Any, at: Sample) -> str | None:
    best = np.asarray(shortcuts.best_action(system, at.belief))
    shape = (WORLDS, *at.candidates.shape[1:])
    if best.shape != shape:
        return f"best_action() returned shape {best.shape}, expected {shape}"
    cost, others = system.cost(system.predict(at.belief, best)), _costs(system, at.belief, at.candidates).min(axis=1)
    if (cost > others + NEARLY * np.abs(others)).any():
        return f"best_action() costs {cost.tolist()}, but candidates cost {others.tolist()}"
    return None


def _best_sequence(system: Any, at: Sample) -> str | None:
    depth = 2 if len(system.candidates()) <= FEW * 2 else 1
    first, cost = shortcuts.best_sequence(system, at.belief, depth)
    search = Lookahead(depth, fused=False)
    search.begin(system, WORLDS, np.random.default_rng(0))
    values = search.values(at.belief)
    least = values.min(axis=1)
    if _differ(cost, least, least) or _differ(values[np.arange(WORLDS), first], least, least):
        return f"best_sequence(depth {depth}) costs {cost.tolist()}, but the best of all costs {least.tolist()}"
    return None


def _plan(system: Any, at: Sample) -> str | None:
    first, cost = shortcuts.plan(system, at.belief, 1)
    own, others = system.cost(system.predict(at.belief, first)), _costs(system, at.belief, at.candidates).min(axis=1)
    if _differ(cost, own, own):
        return f"plan(depth 1) says {cost.tolist()}, but its actions cost {own.tolist()}"
    if (own > others + NEARLY * np.abs(others)).any():
        return f"plan(depth 1) costs {own.tolist()}, but candidates cost {others.tolist()}"
    return None


def _linear_cost(system: Any, at: Sample) -> str | None:
    predicted = system.predict(at.belief, at.candidates[None])
    if "covariance" not in getattr(predicted, "_fields", ()):
        return None
    cost = system.cost(predicted)
    P = predicted.covariance
    trace = trace_cost(P.reshape(*cost.shape, -1, *P.shape[-2:]), np.asarray(shortcuts.linear_cost(system).weights))
    if _differ(cost - cost[:, :1], trace - trace[:, :1], np.abs(trace).max(axis=1)):
        return "cost() and trace(Lambda P) of two candidates differ by different amounts"
    return None


def _gain(system: Any, at: Sample) -> str | None:
    everything = system.candidates()
    gain = np.asarray(shortcuts.gain(system, at.belief, 0, 1))
    if gain.shape != (WORLDS, len(everything)):
        return f"gain() returned shape {gain.shape}, expected {(WORLDS, len(everything))}"
    cost = _costs(system, at.belief, everything)
    ready = (shortcuts.delay(system, at.belief) == 0) & system.mask(at.belief)
    for env in range(WORLDS):
        now = np.flatnonzero(ready[env])
        if len(now):
            total = gain[env, now] + cost[env, now]  # the cost without a measurement, equal for all candidates
            if np.ptp(total) > EXACT * np.abs(cost[env]).max():
                return f"gain() of one step and the predicted cost add up to {total.min():.9g} ... {total.max():.9g}"
    return None


def _delay(system: Any, at: Sample) -> str | None:
    delay, shape = np.asarray(shortcuts.delay(system, at.belief)), (WORLDS, len(system.candidates()))
    if delay.shape != shape or delay.dtype.kind not in "iu":
        return f"delay() returned shape {delay.shape} of {delay.dtype}, expected {shape} of integers"
    return "delay() is negative" if (delay < 0).any() else None


def _spending(system: Any, at: Sample) -> str | None:
    spending, shape = np.asarray(shortcuts.spending(system)), (len(system.candidates()),)
    if spending.shape != shape or (spending < 0).any():
        return f"spending has shape {spending.shape} and the least value {spending.min()}, expected {shape}, none < 0"
    return None if "energy" in at.belief._fields else "the belief has no field energy, the account for spending"


def _most_information(system: Any, at: Sample) -> str | None:
    actions, feasible = shortcuts.most_information(system, at.belief)
    least = system.information(at.belief, actions).min(axis=1)
    short = least < system.threshold * (1.0 - EXACT)
    if (short & feasible).any():
        return f"most_information() gives {least.tolist()}, less than the threshold {system.threshold:g}"
    return None


def _sensor_by_sensor(system: Any, at: Sample) -> str | None:
    pulses, sensors = system.action_set, shortcuts.sensor_by_sensor(system)
    predicted = sensors.begin(at.belief)
    C = pulses.unit_covariance(at.candidates[:1])  # (1, sensor, 2, 2)
    rows, windows = pulses.windows(at.candidates[:1])
    windows, alarm = windows[rows], np.broadcast_to(pulses.alarms(at.candidates[:1]), rows.shape)
    want = _costs(system, at.belief, at.candidates[:1])[:, 0]
    *others, last = range(C.shape[1])
    for sensor in others:
        each = (np.repeat(a[:, sensor], WORLDS, axis=0) for a in (C, windows, alarm))
        predicted = sensors.after(predicted, sensor, *each)
    got = sensors.costs(predicted, last, C[None, :, last], windows[None, :, last], alarm[:, last])[:, 0]
    return f"sensor by sensor costs {got.tolist()}, predict() {want.tolist()}" if _differ(got, want, want) else None


def _decision_makers(system: Any, at: Sample) -> str | None:
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


def _fused(system: Any, at: Sample) -> str | None:
    """The compiled step against the sequence of its parts, leaf by leaf."""
    action = np.repeat(at.candidates[-1:], WORLDS, axis=0)
    parts, again = (system.composed_transition(at.state, action, at.world) for _ in range(2))
    differing = _differing(again, parts)
    if differing:
        return f"{differing} differs if the same step is repeated, expected a tracker that keeps nothing in itself"
    differing = _differing(shortcuts.fused_transition(system, at.state, action, at.world), parts)
    return f"{differing} differs from that of move(), measure(), track() and annotate()" if differing else None


def _differing(state: Any, other: Any) -> str | None:
    """The first array in which two states differ by more than rounding."""
    for half in ("truth", "belief"):
        got, want = getattr(state, half), getattr(other, half)
        for name, value in want._asdict().items():
            if isinstance(value, np.ndarray) and not np.allclose(getattr(got, name), value, EXACT, 0.0, equal_nan=True):
                return f"{name} of the {half}"
    return None


def _recursion(system: Any, at: Sample) -> str | None:
    """Two steps of the recursion against ``transition`` and ``cost``."""
    found, candidates = shortcuts.deterministic_recursion(system, at.world), system.candidates()
    state, P = system.initial(at.world), np.array(found.covariance)
    for step, index in enumerate((0, len(candidates) - 1)):
        state = system.transition(state, np.repeat(candidates[[index]], WORLDS, axis=0), at.world)
        ahead = found.F @ P @ found.F.T + found.Q
        S = found.M @ ahead @ found.M.T + found.R[:, step, index]
        P = ahead - ahead @ found.M.T @ np.linalg.solve(S, found.M @ ahead)
        cost = np.diagonal(P, axis1=1, axis2=2) @ found.weights
        want = system.cost(state.belief)
        if _differ(cost, want, want):
            return f"step {step + 1} costs {cost.tolist()}, but transition() leads to {want.tolist()}"
    return None


def _gain_by_target(system: Any, at: Sample) -> str | None:
    ahead = np.full((WORLDS, at.belief.visible.shape[2]), 3)
    got, want = shortcuts.gain_by_target(system, at.belief, 0, ahead), shortcuts.gain(system, at.belief, 0, 3)
    return None if np.array_equal(got, want) else "gain_by_target() of 3 steps for all is not gain()"


def _innovation_covariance(system: Any, at: Sample) -> str | None:
    S, shape = shortcuts.innovation_covariance(system, at.belief, at.candidates[None]), (WORLDS, len(at.candidates))
    if S.shape[:2] != shape or not (np.linalg.det(S) > 0.0).all():
        return f"innovation_covariance() returned shape {S.shape}, expected {shape} matrices of positive determinant"
    return None


def _next_pulse(system: Any, at: Sample) -> str | None:
    P, eta = shortcuts.next_pulse(system, at.belief)
    before, after = np.diagonal(P, axis1=1, axis2=2) @ system.weights, _costs(system, at.belief, at.candidates)
    if not (eta > 0.0).all() or (after > before[:, None] * (1.0 + EXACT)).any():
        return f"next_pulse() costs {before.tolist()} before a measurement, candidates {after.max(axis=1).tolist()}"
    return None


def _measured_fields(system: Any, at: Sample) -> str | None:
    known, truth = shortcuts.measured_fields(system), system.move(at.state.truth, at.belief.step, at.world)
    action = np.repeat(at.candidates[-1:], WORLDS, axis=0)
    values = known.values(system.measure(truth, at.belief, action, at.world))
    for what, got, fields in (
        ("values", values, known.fields),
        ("settings", known.settings(at.belief), known.setting_fields),
    ):
        if got.shape != (WORLDS, len(fields)) or not np.isfinite(got).all():
            return f"{what} have shape {got.shape}, expected {(WORLDS, len(fields))} finite numbers"
    return None


def _gain_per_second(system: Any, at: Sample) -> str | None:
    got, shape = shortcuts.gain_per_second(system, at.belief), (WORLDS, len(system.candidates()))
    return None if got.shape == shape else f"gain_per_second() returned shape {got.shape}, expected {shape}"


def _cost_to_come(system: Any, at: Sample) -> str | None:
    """A longer rest costs more."""
    short, long = (shortcuts.cost_to_come(system, at.belief, seconds) for seconds in (0.1, 0.2))
    falls = short.shape != (WORLDS,) or not (long > short).all()
    return f"cost_to_come() of 0.1 s is {short.tolist()}, but of 0.2 s {long.tolist()}" if falls else None


def _sensed_band(system: Any, at: Sample) -> str | None:
    """Shapes, and a clear spectrum costs at most as much as one that is occupied."""
    band, everything = shortcuts.sensed_band(system), system.candidates()
    heard, last = band.noise(at.belief, 3), band.last(at.belief)
    channels = band.held.shape[1]
    if band.held.shape[0] != len(everything) or heard.shape != (WORLDS, 3, channels) or last.shape != (WORLDS,):
        return f"held, noise and last have shapes {band.held.shape}, {heard.shape} and {last.shape}"
    clear, occupied = (band.cost(at.belief, np.full((WORLDS, channels), p)) for p in (0.0, 1.0))
    if clear.shape != (WORLDS, len(everything)) or (clear > occupied * (1.0 + EXACT)).any():
        return f"cost() has shape {clear.shape}, or a clear spectrum costs more than an occupied one"
    return None


RULE = DwellRule(long=0.3, worth=2.0, age=-0.3)


def _scores(system: Any, at: Sample) -> str | None:
    got, shape = shortcuts.scores(system, at.belief, RULE), (WORLDS, len(system.candidates()))
    if got.shape != shape or np.isnan(got).any():
        return f"scores() returned shape {got.shape}, expected {shape} and no NaN"
    return None


def _simulate(system: Any, at: Sample) -> str | None:
    tried = np.repeat(system.candidates()[None, -2:], WORLDS, axis=0)
    got = shortcuts.simulate(system, at.belief, tried, RULE, 0.05, 1)
    if got.shape != tried.shape or not np.isfinite(got).all():
        return f"simulate() returned shape {got.shape}, expected {tried.shape} finite numbers"
    return None


def _constants(system: Any, at: Sample) -> str | None:
    constants, candidates = shortcuts.constants(system), system.candidates()
    if constants.ndim != candidates.ndim or constants.shape[1:] != candidates.shape[1:] or not len(constants):
        wanted = ("n >= 1", *candidates.shape[1:])
        return f"constants() returned shape {constants.shape}, expected ({', '.join(map(str, wanted))})"
    if candidates.dtype.kind in "iu" and not np.isin(constants, candidates).all():
        return "constants() has an index that candidates() lacks"
    return None


def _named_constants(system: Any, at: Sample) -> str | None:
    for name, action in shortcuts.named_constants(system).items():
        if "," in name or name.isdigit() or np.shape(action) != at.candidates.shape[1:]:
            return f"{name!r} is {action!r}, expected a name without comma, no integer, and one action"
    return None


def _baselines(system: Any, at: Sample) -> str | None:
    for name, (scheduler, changed) in shortcuts.baselines(system).items():
        if unknown := sorted(set(changed) - {info.name for info in parameter_infos(type(system))}):
            return f"{name!r} plays {scheduler!r} with {unknown}, expected parameters of the system"
    return None


def _target_of_action(system: Any, at: Sample) -> str | None:
    got, count = shortcuts.target_of_action(system), len(system.candidates())
    if got.ndim != 2 or len(got) != count or got.dtype.kind not in "iu":
        return f"target_of_action() returned shape {got.shape} of {got.dtype}, expected ({count}, beams) of integers"
    return None


CHECKS: dict[str, Check] = {
    "best_action": _best_action,
    "best_sequence": _best_sequence,
    "plan": _plan,
    "linear_cost": _linear_cost,
    "gain": _gain,
    "gain_by_target": _gain_by_target,
    "delay": _delay,
    "spending": _spending,
    "most_information": _most_information,
    "sensor_by_sensor": _sensor_by_sensor,
    "innovation_covariance": _innovation_covariance,
    "next_pulse": _next_pulse,
    "measured_fields": _measured_fields,
    "gain_per_second": _gain_per_second,
    "cost_to_come": _cost_to_come,
    "scores": _scores,
    "simulate": _simulate,
    "fused_transition": _fused,
    "deterministic_recursion": _recursion,
    "constants": _constants,
    "named_constants": _named_constants,
    "baselines": _baselines,
    "sensed_band": _sensed_band,
    "target_of_action": _target_of_action,
}
