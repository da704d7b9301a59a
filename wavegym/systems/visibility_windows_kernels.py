"""Compiled windows of visibility: every step observes the coming ones."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from wavegym.core.kernels import kernel


@kernel
def coming(visible, step, most, now, changes, share):
    """Fill the fields of ``Coming``, (e, t) each; visible (e, H, t)."""
    horizon = visible.shape[1]
    for e in range(len(step)):
        for t in range(visible.shape[2]):
            first, seen, change = step[e] < horizon and visible[e, step[e], t], 0, most
            for k in range(most):
                there = step[e] + k < horizon and visible[e, step[e] + k, t]
                seen += there
                if there != first:
                    change = min(change, k)
            now[e, t], changes[e, t], share[e, t] = first, change, seen / most
