"""Operations on batches of worlds and states: nested tuples of arrays, with or without names; axis 0 = environment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from wavegym.core.arrays import Array


def tree_map(function: Callable[..., Any], *trees: Any) -> Any:
    """Apply ``function`` to corresponding leaves of tuples of one form, with names or without; None stays None."""
    if len(trees) == 1:
        return _each(function, trees[0])
    first = trees[0]
    if isinstance(first, tuple):
        return _like(first, [tree_map(function, *leaves) for leaves in zip(*trees, strict=True)])
    return None if first is None else function(*trees)


def _each(function: Callable[[Any], Any], tree: Any) -> Any:
    """``tree_map`` of one tree, faster: planners apply it to thousands of small trees."""
    if isinstance(tree, tuple):
        return _like(tree, [_each(function, leaf) for leaf in tree])
    return None if tree is None else function(tree)


def _like(tree: Any, leaves: Sequence[Any]) -> Any:
    """A tuple of the type of ``tree``: a NamedTuple, or a plain one."""
    return getattr(tree, "_make", tuple)(leaves)


def stack(trees: Sequence[Any]) -> Any:
    """One tree with a new leading axis from many trees of the same shape."""

    def join(*leaves: Array) -> Array:
        if np.ndim(leaves[0]) == 0:
            return np.array(leaves)
        return np.concatenate(leaves).reshape(len(leaves), *leaves[0].shape)  # ten times faster than np.stack

    return tree_map(join, *trees)


def leaves(tree: Any) -> list[Any]:
    """The arrays of a tree, from left to right."""
    found: list[Any] = []
    tree_map(found.append, tree)
    return found


def refilled(tree: Any, leaves: Sequence[Any]) -> Any:
    """A tree of the same form with other arrays, in the order of ``leaves``.

    Raises:
        ValueError: another number of arrays, or one of another kind of numbers or with another number of axes.
    """
    following = iter(leaves)

    def fill(leaf: Array) -> Array:
        fresh = next(following, None)
        if not isinstance(fresh, np.ndarray) or (fresh.dtype, fresh.ndim) != (leaf.dtype, leaf.ndim):
            raise ValueError(f"an array is {type(fresh).__name__}, expected {leaf.dtype} with {leaf.ndim} axes")
        return fresh

    made = tree_map(fill, tree)
    if next(following, None) is not None:
        raise ValueError(f"there are {len(leaves)} arrays, more than the tree has")
    return made


def copied(tree: Any) -> Any:
    """A copy with fresh arrays."""
    return tree_map(lambda leaf: leaf.copy(), tree)


def take(tree: Any, rows: Array) -> Any:
    """The given rows, as fresh arrays."""
    return tree_map(lambda leaf: leaf[rows], tree)


def first(tree: Any, count: int | None) -> Any:
    """The first ``count`` rows, as views; None for all."""
    return tree_map(lambda leaf: leaf[:count], tree)


def repeated(tree: Any, times: int) -> Any:
    """Each row ``times`` times in succession, as fresh arrays."""
    return tree_map(lambda leaf: leaf.repeat(times, axis=0), tree)


def scattered(tree: Any, rows: Array, part: Any) -> Any:
    """A copy of ``tree`` with ``part`` in the given rows; arrays returned earlier stay unchanged."""

    def replace(leaf: Array, fresh: Array) -> Array:
        copy = leaf.copy()
        copy[rows] = fresh
        return copy

    return tree_map(replace, tree, part)


def merged(fresh: Any, rows: Array, kept: Any) -> Any:
    """``fresh`` with the given rows of ``kept``; a leaf that both share is returned as it is."""

    def merge(new: Array, old: Array) -> Array:
        if new is old:
            return new
        copy = new.copy()
        copy[rows] = old[rows]
        return copy

    return tree_map(merge, fresh, kept)


def overwrite(tree: Any, rows: Array, part: Any) -> None:
    """Write ``part`` into the given rows in place: for worlds, which are large and not shared."""

    def replace(leaf: Array, fresh: Array) -> None:
        leaf[rows] = fresh

    tree_map(replace, tree, part)
