"""Ratios of CPU time, measured so that a machine's changing speed cancels: both sides in turn, the median ratio."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import NamedTuple


class Ratio(NamedTuple):
    """How much faster ours is than the peer's, per unit of work."""

    ours_us: float
    peer_us: float
    ratio: float
    low: float  # least and greatest ratio seen
    high: float


def cpu_us(work: Callable[[], int]) -> float:
    """CPU microseconds per unit of work; ``work`` returns how many units it did."""
    start = time.process_time()
    units = work()
    return (time.process_time() - start) / units * 1e6


def compare(ours: Callable[[], int], peer: Callable[[], int], rounds: int = 9) -> Ratio:
    """Time both in turn, after one round that is not counted (compilation, caches)."""
    ours(), peer()
    pairs = [(cpu_us(ours), cpu_us(peer)) for _ in range(rounds)]
    ratios = [theirs / mine for mine, theirs in pairs]
    mine, theirs = (statistics.median(column) for column in zip(*pairs, strict=True))
    return Ratio(mine, theirs, statistics.median(ratios), min(ratios), max(ratios))
