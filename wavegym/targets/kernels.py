"""The compiled scan behind random target paths: it runs at every reset of every episode."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wavegym.kernels import kernel

Array = NDArray[np.float64]


@kernel
def scan(step: Array, start: Array, noise: Array) -> Array:
    """One path x_{k+1} = F x_k + L w_k.

    Args:
        step: F beside the lower triangular L, (n, 2 n); one array, because each costs 0.2 us at the call.
        start: x_0, (n,).
        noise: standard normal w_k, (steps, n).

    Returns:
        x_0 ... x_steps, (steps + 1, n).
    """
    x = np.empty((noise.shape[0] + 1, len(start)))
    _fill(step, start, noise, x)
    return x


@kernel
def scan_batch(step: Array, start: Array, noise: Array) -> Array:
    """As ``scan`` for a flat batch: start (path, n), noise (path, steps, n), result (path, steps + 1, n)."""
    paths, steps, n = noise.shape
    x = np.empty((paths, steps + 1, n))
    for p in range(paths):
        _fill(step, start[p], noise[p], x[p])
    return x


@kernel
def _fill(step: Array, start: Array, noise: Array, x: Array) -> None:
    n = len(start)
    for i in range(n):
        x[0, i] = start[i]
    for k in range(len(noise)):
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += step[i, j] * x[k, j]
            for j in range(i + 1):
                total += step[i, n + j] * noise[k, j]
            x[k + 1, i] = total
