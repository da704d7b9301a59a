"""CMA-ES over a vector of constants, within a budget of evaluations or of CPU seconds that is counted."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from cmaes import CMA

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int, check_positive

Cost = Callable[[Array], float]
DIGITS = 4  # of recorded constants
RESTARTS, SPREAD = 2, 0.15  # searches of constants; first standard deviation, as a share of the intervals


class Found(NamedTuple):
    """The end of a search."""

    point: Array  # (d,) the point of least cost
    cost: float
    mean: Array  # (d,) the mean of the last distribution: less fitted to the worlds of the search than ``point``


class Budget:
    """The limits of a search, and what it has used.

    With evaluations alone a search is deterministic. With CPU seconds the number of evaluations depends on the machine;
    ``evaluations`` says how many were done.

    Args:
        most: evaluations; None for any number.
        seconds: CPU seconds of this process; None for any number.

    Raises:
        InputError: a number out of range, or neither limit.
    """

    def __init__(self, most: int | None = None, seconds: float | None = None) -> None:
        if most is None and seconds is None:
            raise InputError("budget has no limit, expected evaluations or CPU seconds (nearest: 1000 evaluations)")
        self.most = None if most is None else check_int("evaluations", most, 1)
        self.seconds = None if seconds is None else check_positive("CPU seconds", seconds)
        self.evaluations, self._start = 0, time.process_time()

    @property
    def used(self) -> float:
        """CPU seconds since the budget was made."""
        return time.process_time() - self._start

    def share(self) -> float:
        """The share that is spent, of whichever limit is nearer."""
        shares = [0.0]
        if self.most is not None:
            shares.append(self.evaluations / self.most)
        if self.seconds is not None:
            shares.append(self.used / self.seconds)
        return max(shares)

    def counted(self, cost: Cost) -> Cost:
        """``cost``, each call of which counts as an evaluation."""

        def count(point: Array) -> float:
            self.evaluations += 1
            return cost(point)

        return count

    def costs(self, cost: Cost, points: Sequence[Array]) -> list[float]:
        """The cost of each point, infinite where the budget is spent before."""
        counted = self.counted(cost)
        return [counted(point) if self.share() < 1.0 else np.inf for point in points]

    def parts(self, count: int) -> Iterator[float]:
        """``count`` shares at which successive searches end; what one leaves over goes to those after it."""
        for n in range(count):
            yield self.share() + (1.0 - self.share()) / (count - n)


def minimised(cost: Cost, start: Array, sigma: float, budget: Budget, until: float, seed: int) -> Found:
    """The least cost that CMA-ES (Hansen and Ostermeier 2001) finds from ``start``.

    It stops when ``until`` of the budget is spent, or when the distribution has converged. The start counts as found;
    without any budget its cost is infinite.

    Args:
        cost: of a point (d,); may be infinite.
        start: (d,), the mean of the first distribution.
        sigma: standard deviation of the first distribution, in every coordinate.
        budget: counts the evaluations.
        until: share of the budget.
        seed: of the random numbers, >= 0.
    """
    counted = budget.counted(cost)
    if budget.share() >= until:
        return Found(start, np.inf, start)
    best, least = start, counted(start)
    if start.size < 2:  # the package needs two coordinates; the second one changes nothing
        found = _searched(lambda x: counted(x[:1]), np.append(start, 0.0), sigma, budget, until, seed)
        best, least = (found.point[:1], found.cost) if found.cost < least else (best, least)
        return Found(best, least, found.mean[:1])
    found = _searched(counted, start, sigma, budget, until, seed)
    return found if found.cost < least else Found(best, least, found.mean)


def mean_of_search(cost: Callable[[int, Array], float], start: Array, sigma: float, budget: Budget, seed: int) -> Array:
    """The mean of the last distribution of CMA-ES, where each generation has worlds of its own.

    No point is the best of all then, and none is fitted to the worlds.

    Args:
        cost: of a generation's number and a point (d,); may be infinite.
        start, sigma, budget, seed: see ``minimised``; the budget is spent in whole generations.
    """
    search, generation = CMA(mean=np.array(start, np.float64), sigma=sigma, seed=seed), 0
    while budget.share() < 1.0 and not search.should_stop():
        counted = budget.counted(partial(cost, generation))
        points = [search.ask() for _ in range(search.population_size)]
        search.tell(_finite([(point, counted(point)) for point in points]))
        generation += 1
    return np.array(search.mean)


def _finite(told: list[tuple[Array, float]]) -> list[tuple[Array, float]]:
    """CMA-ES only ranks, but its checks need numbers."""
    worst = max((value for _, value in told if np.isfinite(value)), default=0.0) + 1.0
    return [(point, value if np.isfinite(value) else worst) for point, value in told]


def _searched(cost: Cost, start: Array, sigma: float, budget: Budget, until: float, seed: int) -> Found:
    search = CMA(mean=np.array(start, np.float64), sigma=sigma, seed=seed)
    best, least = start, np.inf
    while not search.should_stop():
        told: list[tuple[Array, float]] = []
        while len(told) < search.population_size and budget.share() < until:
            point = search.ask()
            told.append((point, cost(point)))
            if told[-1][1] < least:
                best, least = told[-1]
        if len(told) < search.population_size:
            break
        search.tell(_finite(told))
    return Found(best, least, search.mean)


class Interval(NamedTuple):
    """Values of a constant, on a linear or a logarithmic scale."""

    low: float
    high: float
    is_log: bool = False

    def share(self, value: float) -> float:
        """Where between the ends ``value`` is: 0 at the low end, 1 at the high one."""
        if self.is_log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def value(self, share: float) -> float:
        """The constant, to the digits recorded; a share beyond an end gives the end."""
        within = min(max(float(share), 0.0), 1.0)
        value = (
            self.low * (self.high / self.low) ** within if self.is_log else self.low + within * (self.high - self.low)
        )
        return float(f"{value:.{DIGITS}g}")


def constants_on_fresh_worlds(
    costs: Callable[[int, dict[str, float]], Array],
    intervals: Mapping[str, Interval],
    start: Mapping[str, float],
    budget: Budget,
    seed: int,
) -> tuple[dict[str, float], Array]:
    """Constants within intervals, by CMA-ES on fresh worlds in each generation, and what they gain on others.

    Args:
        costs: logarithms (world,) of the costs of constants by name in the worlds of a generation.
        intervals, budget, seed: see ``searched_constants``.
        start: constants to start from.

    Returns:
        The constants, and their ``costs`` minus those of the start in the worlds of generation -1.
    """
    found = mean_of_search(
        lambda generation, point: float(costs(generation, _named(point, intervals)).mean()),
        np.array([interval.share(start[name]) for name, interval in intervals.items()]), SPREAD, budget, seed
    )  # fmt: skip
    constants = _named(found, intervals)
    return constants, costs(-1, constants) - costs(-1, dict(start))


def _named(point: Array, intervals: Mapping[str, Interval]) -> dict[str, float]:
    return {name: interval.value(share) for (name, interval), share in zip(intervals.items(), point, strict=True)}


def searched_constants(
    cost: Callable[[dict[str, float]], float],
    intervals: Mapping[str, Interval],
    starts: Sequence[Mapping[str, float]],
    budget: Budget,
    seed: int,
) -> tuple[dict[str, float], float]:
    """Constants of least cost within intervals, and their cost: CMA-ES from the best of the starts.

    Args:
        cost: of constants by name; may be infinite.
        intervals: of each constant.
        starts: constants to try first.
        budget: of evaluations or CPU seconds, spent whole.
        seed: of the random numbers, >= 0.
    """
    points = [np.array([interval.share(start[name]) for name, interval in intervals.items()]) for start in starts]
    values = budget.costs(lambda point: cost(_named(point, intervals)), points)
    order = np.argsort(values, kind="stable")
    best, least = points[order[0]], values[order[0]]
    for n, until in enumerate(budget.parts(RESTARTS)):
        start = best if n else points[order[0]]
        found = minimised(lambda point: cost(_named(point, intervals)), start, SPREAD, budget, until, seed + n)
        if found.cost < least:
            best, least = found.point, found.cost
    return _named(best, intervals), least
