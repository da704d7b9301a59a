"""The information reduction factor in compiled form: table look-up for other kernels, and a Monte Carlo simulation."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import exponential, normal, stream, uniform
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


@kernel
def simulated_reduction(key, scenes, clutter, gate, pd):
    """Mean and standard error of |nu|^2 / 2 over ``scenes`` drawn innovations nu of the PDA; each (p,) for pd (p,).

    A scene holds a target's return, standard normal in whitened coordinates, and clutter. All Pd use the same scenes.
    Each scene counts as detected and as missed, weighted by the probabilities. The clutter's squared radii are a
    Poisson process on (0, gate^2), since area is proportional to them: their spacings are exponential.
    """
    spacing, edge = gate * gate / clutter, gate * gate
    inside = 1.0 - np.exp(-0.5 * edge)
    total, square = np.zeros(len(pd)), np.zeros(len(pd))
    for scene in range(scenes):
        own = stream(key, scene)
        x, y = normal(own, 0), normal(own, 1)
        target = np.exp(-0.5 * (x * x + y * y)) if x * x + y * y < edge else 0.0
        weights, sum_x, sum_y, i = 0.0, 0.0, 0.0, 2
        radius2 = spacing * exponential(own, i)
        while radius2 < edge:
            weight, angle = np.exp(-0.5 * radius2), 2.0 * np.pi * uniform(own, i + 1)
            weights += weight
            sum_x += weight * np.sqrt(radius2) * np.cos(angle)
            sum_y += weight * np.sqrt(radius2) * np.sin(angle)
            i += 2
            radius2 += spacing * exponential(own, i)
        for p in range(len(pd)):
            missed = 2.0 * clutter / edge * (1.0 - pd[p] * inside) / pd[p]
            without = 1.0 / (missed + weights)
            share = 1.0 / (missed + weights + target)
            x_with, y_with = share * (sum_x + target * x), share * (sum_y + target * y)
            value = 0.5 * (1.0 - pd[p]) * without * without * (sum_x * sum_x + sum_y * sum_y)
            value += 0.5 * pd[p] * (x_with * x_with + y_with * y_with)
            total[p] += value
            square[p] += value * value
    mean = total / scenes
    return mean, np.sqrt((square / scenes - mean * mean) / scenes)
