"""The compiled GOSPA metric; ``track_metrics.py`` has the public function."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import kernel


@kernel
def assign(truth, present, tracks, alive, c, p, least):
    """Sum of (d / c)^p over the pairs of the best assignment, and the number of pairs, for one time step.

    ``least`` (2^targets,) is scratch space: ``least[A]`` is the least sum that assigns the tracks so far to exactly the
    targets of the bit mask A. Only pairs closer than c are assigned. Each pair fewer costs 1. Nothing is subtracted
    from the sums, because their terms are very small at a high order.
    """
    targets = len(truth)
    least[0] = 0.0
    for chosen in range(1, 1 << targets):
        least[chosen] = np.inf
    for n in range(len(tracks)):
        if not alive[n]:
            continue
        for chosen in range((1 << targets) - 1, 0, -1):  # downwards, so that each track is used at most once
            for t in range(targets):
                if chosen >> t & 1 and present[t]:
                    squared = 0.0
                    for k in range(truth.shape[1]):
                        squared += (truth[t, k] - tracks[n, k]) ** 2
                    if squared < c * c:
                        other = least[chosen ^ (1 << t)] + (np.sqrt(squared) / c) ** p
                        least[chosen] = min(least[chosen], other)
    best = pairs = 0
    for chosen in range(1, 1 << targets):
        count = 0
        for t in range(targets):
            count += chosen >> t & 1
        if least[chosen] - least[best] < count - pairs:
            best, pairs = chosen, count
    return least[best], pairs


@kernel
def gospa(truth, present, tracks, alive, c, p, out):
    """Distance, localisation, missed and false of a batch with one flat leading axis, to out (batch, 4)."""
    least = np.empty(1 << truth.shape[1])
    cut = c**p
    for e in range(len(truth)):
        near, pairs = assign(truth[e], present[e], tracks[e], alive[e], c, p, least)
        missed, false = 0.5 * (present[e].sum() - pairs), 0.5 * (alive[e].sum() - pairs)
        out[e, 0] = c * (near + missed + false) ** (1.0 / p)
        out[e, 1], out[e, 2], out[e, 3] = near * cut, missed * cut, false * cut
