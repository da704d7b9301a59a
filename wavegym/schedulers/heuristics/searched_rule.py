"""A rule that is linear in named forecasts and resources, its weights found by CMA-ES on tuning worlds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.policy import Policy
from wavegym.core.shortcuts import delay
from wavegym.core.system import System
from wavegym.schedulers.heuristics.base import Heuristic, greatest
from wavegym.schedulers.heuristics.cma_search import Budget, minimised
from wavegym.schedulers.heuristics.rule_features import PRICE, RATIO, RuleFeatures
from wavegym.schedulers.myopic import Myopic
from wavegym.schedulers.rollout import allowed
from wavegym.schedulers.tuning import Constants, log_cost

SIGMA, POLISH = 0.5, 0.2  # of the first distribution, of weights of norm 1; of the search over all features
DIGITS = 6  # of recorded weights
PRICES = tuple(float(price) for price in np.geomspace(0.1, 30.0, 8))  # first prices tried
FIRST = 0.5  # share of the budget for the forms, before all features are searched together


class ChangedFeaturesError(InputError):
    """The features of a system are no longer those that a rule was found for."""


class SearchedRule(Heuristic):
    """The allowed candidate of the greatest weighted sum of its features, each over its scale.

    Args:
        features: names of all features that the system has, as ``RuleFeatures`` lists them.
        weights: of each feature.
        scales: of each feature, constants found on tuning worlds; 0 for a feature that never differs there.

    Raises:
        InputError: lists of different lengths.
        ChangedFeaturesError: at ``begin``, features that are not the system's.
    """

    name = "searched-rule"

    def __init__(self, features: Sequence[str], weights: Sequence[float], scales: Sequence[float]) -> None:
        if not len(features) == len(weights) == len(scales):
            lengths = f"{len(features)} features, {len(weights)} weights and {len(scales)} scales"
            raise InputError(f"searched-rule has {lengths}, expected as many of each")
        self.features = tuple(features)
        self.weights, self.scales = np.asarray(weights, np.float64), np.asarray(scales, np.float64)

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        super().begin(system, num_envs, rng)
        self._features = RuleFeatures(system)
        if self.features != self._features.names:
            changed = sorted(set(self.features) ^ set(self._features.names))
            what = f"it differs in {', '.join(changed)}" if changed else "it differs in order"
            command = "python -m wavegym.evaluation.tune_constants ID"
            raise ChangedFeaturesError(
                f"searched-rule was found for other features of {type(system).__name__} ({what}), expected its weights"
                f" to be searched anew with: {command}"
            )
        used = np.flatnonzero((self.weights != 0.0) & (self.scales > 0.0))
        self._used = tuple(self.features[n] for n in used)
        self._factors = self.weights[used] / self.scales[used]

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        values = np.zeros((len(belief.step), len(self.candidates)))
        made = self._features(belief, self._used)
        for n, factor in enumerate(self._factors):  # one after another: a batch must equal its elements to the last bit
            values += factor * made[..., n]
        return self.candidates[greatest(values, mask, delay(self.system, belief))]


class FoundRule(NamedTuple):
    """A rule and what its search spent."""

    constants: Constants
    cost: float  # log_cost on all worlds
    evaluations: int  # of the search; its ends are compared on all worlds besides
    cpu_seconds: float


def feature_scales(system: System, reference: Policy, worlds: Any) -> Array:
    """Root mean square deviation of each feature among the allowed candidates of a decision, (feature,).

    A feature that is the same for all candidates decides nothing, so only differences count.

    Args:
        system: the closed loop.
        reference: the policy that is played.
        worlds: tapes for tuning, axis 0 = world.
    """
    features = RuleFeatures(system)
    state = system.initial(worlds)
    reference.begin(system, len(state.belief.step), np.random.default_rng(0))
    total, count = np.zeros(len(features.names)), 0
    for _ in range(system.horizon):
        belief, live = state.belief, ~system.terminal(state.belief)
        mask = allowed(system, belief)
        values = features(belief, features.names)
        is_on = np.ones(values.shape[:2], np.bool_) if mask is None else mask
        is_on = is_on & live[:, None] & (is_on.sum(axis=1) > 1)[:, None]
        number = np.maximum(is_on.sum(axis=1), 1)[:, None]
        mean = np.where(is_on[..., None], values, 0.0).sum(axis=1) / number
        off = np.where(is_on[..., None], values - mean[:, None], 0.0)
        total += (off * off).sum(axis=(0, 1))
        count += int(is_on.sum())
        state = system.transition(state, reference.act(belief, None, mask), worlds)
    return np.sqrt(total / max(count, 1))


def search_rule(
    system: System, worlds: Any, budget: Budget, seed: int = 0, reference: Policy | None = None, few: Any = None
) -> FoundRule:
    """The weights of least ``log_cost`` that CMA-ES finds.

    The search tries each form of rule from its best start, then all features together from the best rule found. If
    budget is left, it continues from the other starts. The starts reproduce the one-step scheduler, the greatest gain
    with a penalty for delay, and the greatest gain minus a price of spending.

    Args:
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world; the ends of all restarts are compared on all of them.
        budget: of evaluations or CPU seconds.
        seed: of the random numbers, >= 0.
        reference: the policy under which the scales are found; the one-step scheduler by default.
        few: the worlds of the search, if not all.

    Raises:
        InputError: the system has no such features, or none differs between candidates.
    """
    few = worlds if few is None else few
    features = RuleFeatures(system)
    scales = np.array([float(f"{scale:.{DIGITS}g}") for scale in feature_scales(system, reference or Myopic(), few)])
    is_varied = scales > 1e-12
    if not is_varied.any():
        raise InputError(f"searched-rule has no feature that differs between the candidates of {type(system).__name__}")

    def made(weights: Array) -> SearchedRule:
        return SearchedRule(features.names, list(weights), list(scales))

    def cost(weights: Array, played: Any = few) -> float:
        return log_cost(system, made(weights), played) if weights.any() else np.inf

    search = _Search(features.names, is_varied, cost, budget, seed)
    for weights in search.ends(features):
        search.keep(rounded(weights), lambda weights: cost(weights, worlds))
    constants = {
        "features": list(features.names),
        "weights": search.best.tolist(),
        "scales": scales.tolist(),
    }
    return FoundRule(constants, search.least, budget.evaluations, budget.used)


def rounded(weights: Array) -> Array:
    """The weights at norm 1, to the digits recorded."""
    norm = float(np.linalg.norm(weights)) or 1.0
    return np.array([float(f"{weight:.{DIGITS}g}") for weight in weights / norm])


class _Search:
    """Restarts over the forms of rules, and the best of their ends."""

    def __init__(self, names: tuple[str, ...], is_varied: Array, cost: Any, budget: Budget, seed: int) -> None:
        self.names, self.is_varied, self.cost = names, is_varied, cost
        self.budget, self.seed = budget, seed
        self.best, self.least = np.zeros(len(names)), np.inf

    def keep(self, weights: Array, cost: Any) -> None:
        """Keep the weights if they are the best so far on all worlds."""
        value = cost(weights)
        if value < self.least:
            self.best, self.least = weights, value

    def ends(self, features: RuleFeatures) -> Iterator[Array]:
        """The points where searches ended."""
        forms = [(names, self._ranked(starts(form, features.names))) for form, names in features.forms.items()]
        spent, number = self.budget.share(), 0
        for n, (names, ranked) in enumerate(forms):
            until = spent + (1.0 - spent) * FIRST * (n + 1) / len(forms)
            for start in ranked[:1]:
                yield start
                yield from self._from(start, [name in names for name in self.names], SIGMA, until, n)
        yield from self._from(self.best, [True] * len(self.names), POLISH, 1.0, len(forms))
        others = [start for _, ranked in forms for start in ranked[1:]]
        while others and self.budget.share() < 1.0:  # all have converged: the starts not yet taken, one after another
            start, number = others[number % len(others)], number + 1
            yield from self._from(start, [True] * len(self.names), SIGMA, 1.0, len(forms) + number)

    def _from(self, start: Array, is_in: Sequence[bool], sigma: float, until: float, number: int) -> Iterator[Array]:
        open_to = np.flatnonzero(self.is_varied & np.asarray(is_in))
        if not len(open_to):
            return

        def whole(part: Array) -> Array:
            weights = np.where(np.isin(np.arange(len(start)), open_to), 0.0, start)
            weights[open_to] = part
            return weights

        norm = float(np.linalg.norm(start)) or 1.0
        found = minimised(
            lambda part: self.cost(whole(part)), start[open_to] / norm, sigma, self.budget, until, self.seed + number
        )
        yield whole(found.point)
        yield whole(found.mean)

    def _ranked(self, points: list[Array]) -> list[Array]:
        """The points that differ from 0, the least cost first."""
        points = [point for point in points if (point * self.is_varied).any()]
        values = self.budget.costs(self.cost, points)
        return [points[n] for n in np.argsort(values, kind="stable")]


def starts(form: str, names: tuple[str, ...]) -> list[Array]:
    """First weights of a form, each (feature,)."""
    listed: list[dict[str, float]] = []
    if form == RATIO:
        listed = [{"ln_cost_ahead": -1.0}, {"ln_cost_4": -1.0}, {"log10_hold_6": 1.0}]
        listed += [{"log10_gain_0_8": 1.0, "ln_delay": -late} for late in (0.0, 1.0, 2.0)]
    elif form == PRICE:
        for gain, resource in (("gain_8", ""), ("gain_8", "*scarcity"), ("hold_2", "*clear_slots")):
            listed += [{gain: 1.0, f"spending{resource}": -price} for price in PRICES]
    known = [weights for weights in listed if all(name in names for name in weights)]
    return [np.array([weights.get(name, 0.0) for name in names]) for weights in known]
