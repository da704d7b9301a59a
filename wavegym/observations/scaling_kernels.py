"""Scaling of observations in compiled form: every environment pays it at every step."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from wavegym.core.kernels import kernel


@kernel
def scale(values, centre, width, limit, out, saturated):
    """out (env, elements) float32 = (values - centre) / width held within +-limit; counts what had to be held."""
    for e in range(values.shape[0]):
        held = 0
        for i in range(values.shape[1]):
            scaled = (values[e, i] - centre[i]) / width[i]
            if scaled > limit:
                scaled = limit
                held += 1
            elif scaled < -limit:
                scaled = -limit
                held += 1
            out[e, i] = scaled
        saturated[e] = held
