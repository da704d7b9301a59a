"""The information reduction factor in compiled form: table look-up for other kernels."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import kernel

GATE = 4.0  # of the table
LIMIT = 1.0 - (1.0 + GATE * GATE / 2.0) * np.exp(-GATE * GATE / 2.0)  # q2 / Pd without clutter


@kernel
def reduction_one(pd, log_clutter, pd_grid, log_clutter_grid, table):
    """q2 for one Pd and one log(rho V), V the volume of the gate g = 4, from the arrays of ``reduction_table()``.

    ``table`` holds log f of q2 = LIMIT Pd / (1 + f rho V / Pd) with f in [0.27, 2.7]. Between grid points log f is
    interpolated bilinearly; beyond the grid it is held. The formula then has the right limits: LIMIT Pd without clutter
    and 2 Pd^2 / (rho V) in heavy clutter.
    """
    if not pd > 0.0:
        return 0.0 if pd == 0.0 else np.nan
    low, high = 0, len(pd_grid) - 1
    while high - low > 1:
        middle = (low + high) >> 1
        if pd < pd_grid[middle]:
            high = middle
        else:
            low = middle
    u = (pd - pd_grid[low]) / (pd_grid[high] - pd_grid[low])
    last = len(log_clutter_grid) - 1
    place = (log_clutter - log_clutter_grid[0]) * (last / (log_clutter_grid[last] - log_clutter_grid[0]))
    place = min(max(place, 0.0), float(last))
    k = min(int(place), last - 1)
    v = place - k
    left = table[low, k] + v * (table[low, k + 1] - table[low, k])
    right = table[high, k] + v * (table[high, k + 1] - table[high, k])
    return LIMIT * pd * pd / (pd + np.exp(log_clutter + left + u * (right - left)))


@kernel
def reduction(pd, clutter, pd_grid, log_clutter_grid, table):
    """``reduction_one`` for arrays of Pd and rho V, both (n,)."""
    out = np.empty(len(pd))
    for e in range(len(pd)):
        out[e] = reduction_one(pd[e], np.log(clutter[e]), pd_grid, log_clutter_grid, table)
    return out
