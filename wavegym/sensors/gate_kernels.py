"""Validation gates in compiled form; ``gates.py`` holds the public functions.

Gate t is the ellipse {z : |L_t^-1 (z - centre_t)| <= gate} with L_t (2, 2) the lower Cholesky factor of the innovation
covariance: centre (t, 2), L (t, 2, 2).
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import batched, inlined, kernel


@kernel
def squared_distance(t, z0, z1, centre, L):
    """|L_t^-1 (z - centre_t)|^2, the squared Mahalanobis distance of z = (z0, z1); NaN where L_t is."""
    w0 = (z0 - centre[t, 0]) / L[t, 0, 0]
    w1 = (z1 - centre[t, 1] - L[t, 1, 0] * w0) / L[t, 1, 1]
    return w0 * w0 + w1 * w1


@kernel
def in_gate(t, z0, z1, centre, L, gate):
    """Whether (z0, z1) lies in gate t; never in one whose L_t is NaN."""
    return squared_distance(t, z0, z1, centre, L) <= gate * gate


@kernel
def in_a_gate(z0, z1, centre, L, present, gate):
    """Whether (z0, z1) lies in a present gate."""
    t = 0
    while t < len(present) and not (present[t] and in_gate(t, z0, z1, centre, L, gate)):
        t += 1
    return t < len(present)


@kernel
def gate_volume_one(t, L, gate):
    """Area of gate t, in the product of the measurement's units."""
    return np.pi * gate * gate * L[t, 0, 0] * L[t, 1, 1]


@inlined
def reach_one(t, L, gate):
    """Half the sides of the box around gate t."""
    return gate * L[t, 0, 0], gate * np.sqrt(L[t, 1, 0] * L[t, 1, 0] + L[t, 1, 1] * L[t, 1, 1])


@batched("(),(m,m)->()")
def volume(gate, L, area, mm):
    """gate_volume_one, element by element."""
    for e in range(area.shape[0]):
        area[e] = gate_volume_one(e, L, gate[e])


@batched("(m),(m),(m,m)->()")
def distance(z, centre, L, squared, mm):
    """squared_distance, element by element."""
    for e in range(squared.shape[0]):
        squared[e] = squared_distance(e, z[e, 0], z[e, 1], centre, L)
