"""The gradient of a maximum over candidates. PyTorch needs ten passes over memory for it."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import kernel


@kernel
def share_gradient(hidden, greatest, above, out):
    """Give each candidate with the greatest value an equal share of the gradient, in the order of ``torch.amax``.

    All arrays are C-contiguous float32.

    Args:
        hidden: (env, candidate, width).
        greatest: (env, width), the greatest values over candidates.
        above: (env, width), the gradient of ``greatest``.
        out: (env, candidate, width), filled with the gradient of ``hidden``.
    """
    envs, candidates, width = hidden.shape
    share = np.empty(width, np.float32)
    for e in range(envs):
        share[:] = np.float32(0.0)
        for c in range(candidates):
            for j in range(width):
                share[j] += np.float32(hidden[e, c, j] == greatest[e, j])
        for j in range(width):
            share[j] = above[e, j] / share[j]
        for c in range(candidates):
            for j in range(width):  # a product, not a branch: zeros have the sign that PyTorch gives them
                out[e, c, j] = np.float32(hidden[e, c, j] == greatest[e, j]) * share[j]
