"""A batch in chunks, one for each thread; kernels run without the interpreter's lock, so chunks run in parallel."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from threading import Lock
from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array


def in_chunks(function: Callable[[Any], Any], batch: Any, count: int, threads: int) -> Any:
    """``function(batch)``, computed for up to ``threads`` chunks of consecutive environments in parallel.

    The result for a batch must be the results for its chunks, one after another, as all systems and rewards promise.
    Then results have the same bits for any number of threads.

    Args:
        function: from a tree of arrays to a tree, which may have dicts as nodes; axis 0 = environment in both.
        batch: the tree. A leaf that the function returns as it is, is returned as it is here, too.
        count: number of environments.
        threads: most threads.
    """
    if min(threads, count) <= 1:
        return function(batch)
    edges = np.linspace(0, count, min(threads, count) + 1).round().astype(int).tolist()
    whole = _Whole(count, trees.leaves(batch))

    def advance(first: int, last: int) -> None:
        part = trees.tree_map(lambda leaf: leaf[first:last], batch)
        whole.take(function(part), trees.leaves(part), slice(first, last))

    spans = list(pairwise(edges))
    others = [_pool(len(spans) - 1).submit(advance, *span) for span in spans[1:]]
    try:
        advance(*spans[0])
    finally:
        errors = [other.exception() for other in others]  # waits for all
    for error in filter(None, errors):
        raise error
    return whole.tree


class _Whole:
    """The results of all chunks in one tree. Each thread copies its own results, so that copying is also parallel."""

    def __init__(self, count: int, given: list[Array]) -> None:
        self.tree: Any = None
        self._count, self._given, self._lock = count, given, Lock()

    def take(self, part: Any, given: list[Array], rows: slice) -> None:
        """Add the result of the chunk in ``rows``, which got the leaves ``given``."""
        passed_on = {id(view): leaf for view, leaf in zip(given, self._given, strict=True)}
        with self._lock:
            if self.tree is None:
                self.tree = _like(part, self._count, passed_on)
        _copy(part, self.tree, rows, passed_on)


def _like(part: Any, count: int, passed_on: dict[int, Array]) -> Any:
    """Empty arrays for ``count`` environments where ``part`` has those of a chunk, or the leaf that is passed on."""
    if isinstance(part, dict):
        return {name: _like(value, count, passed_on) for name, value in part.items()}
    if isinstance(part, tuple):
        return type(part)(*(_like(value, count, passed_on) for value in part))
    if part is None:
        return None
    return passed_on[id(part)] if id(part) in passed_on else np.empty((count, *part.shape[1:]), part.dtype)


def _copy(part: Any, whole: Any, rows: slice, passed_on: dict[int, Array]) -> None:
    """Copy the results of a chunk into its rows of the whole."""
    if isinstance(part, dict):
        for name, value in part.items():
            _copy(value, whole[name], rows, passed_on)
    elif isinstance(part, tuple):
        for value, place in zip(part, whole, strict=True):
            _copy(value, place, rows, passed_on)
    elif part is not None and id(part) not in passed_on:
        whole[rows] = part


@cache
def _pool(workers: int) -> ThreadPoolExecutor:
    """The threads that all environments of this process share."""
    return ThreadPoolExecutor(workers, "wavegym")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a child process has none of its parent's threads
