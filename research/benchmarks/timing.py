"""Ratios of CPU time: both sides are measured in turn and the median is taken, so that changes of speed cancel."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple


class Ratio(NamedTuple):
    """Speed of wavegym relative to the peer, per unit of work."""

    ours_us: float
    peer_us: float
    ratio: float
    low: float  # least and greatest ratio of all rounds
    high: float


def cpu_us(work: Callable[[], int]) -> float:
    """CPU microseconds per unit of work; ``work`` returns the number of units done."""
    start = time.process_time()
    units = work()
    return (time.process_time() - start) / units * 1e6


def compare(ours: Callable[[], int], peer: Callable[[], int], rounds: int = 9) -> Ratio:
    """Time both in turn after one round that does not count (compilation, caches)."""
    ours(), peer()
    return summed_up([(cpu_us(ours), cpu_us(peer)) for _ in range(rounds)])


def summed_up(pairs: Sequence[tuple[float, float]]) -> Ratio:
    """The medians of (our, their) times of all rounds."""
    ratios = [theirs / mine for mine, theirs in pairs]
    mine, theirs = (statistics.median(column) for column in zip(*pairs, strict=True))
    return Ratio(mine, theirs, statistics.median(ratios), min(ratios), max(ratios))
