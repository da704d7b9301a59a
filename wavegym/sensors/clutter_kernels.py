"""Poisson clutter in the union of validation gates, in compiled form; ``clutter.py`` holds the public function.

The random numbers are counter-based. Gate t of a key has its own stream; its point n uses the draws 3n (gap to the
previous point, in expected points), 3n + 1 (radius) and 3n + 2 (angle). If another waveform makes a gate larger, the
gate keeps its points in whitened coordinates and gains new ones: waveforms are compared on the same clutter.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import exponential, stream, uniform
from wavegym.core.kernels import kernel
from wavegym.sensors.gate_kernels import gate_volume_one, in_gate


@kernel
def room(z, count):
    """Return z if it has at least ``count`` rows, else a larger array that begins with the rows of z."""
    if count <= len(z):
        return z
    larger = np.empty((2 * count, 2))
    for m in range(len(z)):
        larger[m, 0], larger[m, 1] = z[m, 0], z[m, 1]
    return larger


@kernel
def in_earlier_gate(t, z0, z1, centre, L, present, gate):
    """Whether (z0, z1) lies in a present gate numbered below t."""
    covered = False
    for s in range(t):
        covered = covered or (present[s] and in_gate(s, z0, z1, centre, L, gate))
    return covered


@kernel
def add_clutter(key, centre, L, present, gate, density, z, count):
    """Append clutter of spatial density ``density``, uniform in the union of the present gates, to z from ``count``.

    centre (t, 2), L (t, 2, 2), present (t,) bool, z (capacity, 2). Returns z, or a larger copy, and the new count.
    The points of a gate arrive with exponential gaps up to its expected count: their number is Poisson with exactly
    that mean. A point that also lies in an earlier gate is dropped, because that gate has filled the overlap. A gate
    without a finite volume gets no points.
    """
    for t in range(len(present)):
        if not present[t]:
            continue
        own = stream(key, t)
        expected = density * gate_volume_one(t, L, gate)
        n, arrival = 0, exponential(own, 0)
        while arrival <= expected < np.inf:
            radius, angle = gate * np.sqrt(uniform(own, 3 * n + 1)), 2.0 * np.pi * uniform(own, 3 * n + 2)
            w0, w1 = radius * np.cos(angle), radius * np.sin(angle)
            z0 = centre[t, 0] + L[t, 0, 0] * w0
            z1 = centre[t, 1] + L[t, 1, 0] * w0 + L[t, 1, 1] * w1
            if not in_earlier_gate(t, z0, z1, centre, L, present, gate):
                z = room(z, count + 1)
                z[count, 0], z[count, 1] = z0, z1
                count += 1
            n += 1
            arrival += exponential(own, 3 * n)
    return z, count
