"""Signal-to-noise ratio in compiled form, for the fused kernels of the systems and for ``snr.py``."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from wavegym.core.kernels import batched, kernel


@kernel
def inverse_snr(r, reference, nearest):
    """1 / eta = (r / reference)^4 with r at least ``nearest``; products, because scalar and array powers may differ."""
    ratio = max(abs(r), nearest) / reference
    square = ratio * ratio
    return square * square


@batched("(),(),()->()")
def snr(r, reference, nearest, out):
    """eta = (reference / r)^4."""
    for e in range(r.shape[0]):
        out[e] = 1.0 / inverse_snr(r[e], reference[e], nearest[e])
