"""Compiled random target paths, which are drawn at every reset."""

from __future__ import annotations

import numpy as np

from wavegym.core.arrays import FloatArray
from wavegym.core.kernels import kernel

Sizes = tuple[int, ...]


@kernel
def scan(step: FloatArray, start: FloatArray, noise: FloatArray, nn: Sizes) -> FloatArray:
    """One path x_{k+1} = F x_k + L w_k.

    Args:
        step: [F L] with the lower triangular L, (n, 2 n); one array, because each argument costs 0.2 us per call.
        start: x_0, (n,).
        noise: standard normal w_k, (steps, n).
        nn: a tuple of n zeros; the compiler knows its length.

    Returns:
        x_0 ... x_steps, (steps + 1, n).
    """
    x = np.empty((1, noise.shape[0] + 1, len(nn)))
    _fill(0, step, start.reshape((1, len(nn))), noise.reshape((1, noise.shape[0], len(nn))), x, nn)
    return x[0]


@kernel
def scan_batch(step: FloatArray, start: FloatArray, noise: FloatArray, nn: Sizes) -> FloatArray:
    """As ``scan`` for a flat batch: start (path, n), noise (path, steps, n), result (path, steps + 1, n)."""
    paths, steps, n = noise.shape
    x = np.empty((paths, steps + 1, n))
    for p in range(paths):
        _fill(p, step, start, noise, x, nn)
    return x


@kernel
def _fill(p: int, step: FloatArray, start: FloatArray, noise: FloatArray, x: FloatArray, nn: Sizes) -> None:
    n = len(nn)
    for i in range(n):
        x[p, 0, i] = start[p, i]
    for k in range(noise.shape[1]):
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += step[i, j] * x[p, k, j]
            for j in range(i + 1):
                total += step[i, n + j] * noise[p, k, j]
            x[p, k + 1, i] = total
