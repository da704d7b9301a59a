"""Pairs of policies whose order by belief is not their order by truth."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.worlds import word
from wavegym.evaluation import statistics
from wavegym.evaluation.account import Account


def reversals(accounts: Mapping[str, Account], root: int) -> list[dict[str, Any]]:
    """The pairs of which one policy costs less by belief and has the larger error by truth, as plain types.

    Both differences are geometric means of paired ratios, and both intervals exclude 0. Of policies that played alike
    the first stands for all.

    Args:
        accounts: on the same worlds, by policy.
        root: of the comparison; the bootstrap follows from it.

    Returns:
        For each pair ``policy``, ``reference``, and the differences ``belief`` and ``truth`` in per cent.
    """
    found = []
    for (name, account), (other, reference) in combinations(_distinct(accounts).items(), 2):
        pairs = (account.cost, reference.cost), (account.squared_error, reference.squared_error)
        if np.prod([_sign(*pair) for pair in pairs]) != -1.0:
            continue  # the same order; the bootstrap is slow
        belief, truth = (_established(*pair, root) for pair in pairs)
        if belief is not None and truth is not None:
            found.append({"policy": name, "reference": other, "belief": belief, "truth": truth})
    return found


def _distinct(accounts: Mapping[str, Account]) -> dict[str, Account]:
    """The accounts without those that repeat an earlier one."""
    distinct: dict[str, Account] = {}
    for name, account in accounts.items():
        if not any(np.array_equal(account.cost, other.cost) for other in distinct.values()):
            distinct[name] = account
    return distinct


def _sign(values: Array, reference: Array) -> float:
    """-1, 0 or 1: the geometric mean of the ratios is below, at or above one; NaN where it is undefined."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.sign(np.log(values / reference.mean(axis=0)).mean()))


def _established(values: Array, reference: Array, root: int) -> float | None:
    """The geometric difference in per cent if its interval excludes 0, else None."""
    rng = np.random.default_rng([root, word("bootstrap")])
    value, ci = statistics.difference(values, reference, rng).geometric
    return value if ci is not None and ci[0] * ci[1] > 0.0 else None
