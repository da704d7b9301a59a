"""Scaling of observations in compiled form: it runs in every step of every environment."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from wavegym.core.kernels import kernel


@kernel
def scale(values, centre, width, limit, out, saturated):
    """out (env, fields) float32 = (values - centre) / width, clipped to +-limit; counts the clipped fields."""
    for e in range(values.shape[0]):
        clipped = 0
        for i in range(values.shape[1]):
            scaled = (values[e, i] - centre[i]) / width[i]
            clipped += int(abs(scaled) > limit)
            out[e, i] = min(max(scaled, -limit), limit)
        saturated[e] = clipped
