"""Compiled pieces of the radar equation, for the fused kernels of the systems and for ``snr.py``."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from wavegym.kernels import batched, kernel


@kernel
def inverse_fourth_power(r, reference, nearest):
    """(reference / r)^4 with r held at ``nearest`` below it; products, so that scalars and arrays agree bit for bit."""
    ratio = reference / max(abs(r), nearest)
    square = ratio * ratio
    return square * square


@batched("(),(),()->()")
def snr(r, reference, nearest, out):
    """eta = (reference / r)^4."""
    for e in range(r.shape[0]):
        out[e] = inverse_fourth_power(r[e], reference[e], nearest[e])
