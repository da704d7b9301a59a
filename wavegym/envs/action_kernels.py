"""Compiled checks of actions, which run in every step of every environment."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import kernel


@kernel
def are_indices(actions, count):
    """Whether all actions (n,) are in [0, count)."""
    inside = True
    for action in actions:
        inside = inside and 0 <= action < count
    return inside


@kernel
def first_forbidden(actions, mask, ignored):
    """The first environment whose action (e,) the mask (e, actions) forbids, or -1; ``ignored`` (e,) or (0,)."""
    for e in range(len(actions)):
        if not mask[e, actions[e]] and not (len(ignored) and ignored[e]):
            return e
    return -1


@kernel
def clip(points):
    """Clip points (e, d) to [-1, 1] in place, up to the first that is not finite; returns whether all are finite."""
    for e in range(points.shape[0]):
        for i in range(points.shape[1]):
            if not np.isfinite(points[e, i]):
                return False
            points[e, i] = min(max(points[e, i], -1.0), 1.0)
    return True


@kernel
def differ(points, others, out):
    """out (e,): whether points (e, d) and others (e, d) differ anywhere."""
    for e in range(points.shape[0]):
        out[e] = False
        for i in range(points.shape[1]):
            if points[e, i] != others[e, i]:
                out[e] = True
