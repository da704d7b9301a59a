"""Decoding of continuous actions in compiled form: it runs in every step of every environment with a box."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import kernel


@kernel
def decode(action, low, high, width, log, value):
    """value (e, d): physical values of actions in [-1, 1]; bounds and scales are (d,).

    ``width`` is the logarithm's where ``log`` is True. Returns whether all actions were inside.
    """
    inside = True
    for e in range(action.shape[0]):
        for i in range(action.shape[1]):
            steps = 0.5 * (action[e, i] + 1.0) * width[i]
            raw = low[i] * np.exp(steps) if log[i] else low[i] + steps
            value[e, i] = min(max(raw, low[i]), high[i])
            inside = inside and abs(action[e, i]) <= 1.0
    return inside
