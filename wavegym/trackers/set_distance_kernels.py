"""The generalised optimal sub-pattern assignment metric in compiled form; ``set_distance.py`` is its public face."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.kernels import kernel


@kernel
def assign(truth, present, tracks, alive, c, p, least):
    """(sum of d^p over the pairs of the best assignment, number of pairs), for one moment.

    ``least`` (2^targets,) is scratch space: what the best pairs of the tracks so far with exactly these targets save,
    against c^p for a pair apart. Only pairs nearer than c save anything.
    """
    targets, cut = len(truth), c**p
    least[0] = 0.0
    for chosen in range(1, 1 << targets):
        least[chosen] = np.inf
    for n in range(len(tracks)):
        if not alive[n]:
            continue
        for chosen in range((1 << targets) - 1, 0, -1):  # downwards: every track is taken once
            for t in range(targets):
                if chosen >> t & 1 and present[t]:
                    squared = 0.0
                    for k in range(truth.shape[1]):
                        squared += (truth[t, k] - tracks[n, k]) ** 2
                    saved = np.sqrt(squared) ** p - cut
                    if saved < 0.0:
                        least[chosen] = min(least[chosen], least[chosen ^ (1 << t)] + saved)
    best = 0
    for chosen in range(1, 1 << targets):
        if least[chosen] < least[best]:
            best = chosen
    pairs = 0
    for t in range(targets):
        pairs += best >> t & 1
    return least[best] + pairs * cut, pairs


@kernel
def gospa(truth, present, tracks, alive, c, p, out):
    """distance, localisation, missed, false for a batch with one flat leading axis, out (moment, 4)."""
    least = np.empty(1 << truth.shape[1])
    for e in range(len(truth)):
        localisation, pairs = assign(truth[e], present[e], tracks[e], alive[e], c, p, least)
        out[e, 1] = localisation
        out[e, 2] = 0.5 * c**p * (present[e].sum() - pairs)
        out[e, 3] = 0.5 * c**p * (alive[e].sum() - pairs)
        out[e, 0] = (out[e, 1] + out[e, 2] + out[e, 3]) ** (1.0 / p)
