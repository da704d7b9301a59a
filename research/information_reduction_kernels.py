"""A Monte Carlo simulation of the information reduction factor."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import exponential, normal, stream, uniform
from wavegym.core.kernels import kernel


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
