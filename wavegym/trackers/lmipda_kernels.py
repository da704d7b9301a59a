"""LMIPDA in compiled form: one receiver's scan, several tracks with existence probabilities, several models each.

``association.py`` holds the public function; arrays hold the tracks of one environment.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel


@inlined
def claims(t, p, mu, pd, existence, density, count, own, claim):
    """own[t] = p^(t)_i = sum_r mu_r p^(t,r)_i, and claim[t] = p^(t)_i P^(t)_i / (1 - P^(t)_i), (measurement,).

    P^(t)_i is the probability that measurement i comes from track t, without regard to the other tracks.
    """
    total = 0.0
    for i in range(count):
        own[t, i] = 0.0
        for r in range(mu.shape[1]):
            own[t, i] += mu[t, r] * p[t, r, i]
        total += own[t, i] / density[t, i]
    for i in range(count):
        mine = pd[t] * existence[t] * own[t, i] / density[t, i] / total if total > 0.0 else 0.0
        claim[t, i] = own[t, i] * mine / (1.0 - mine)


@kernel
def lmipda_one(p, mu, pd, existence, density, count, beta, own, claim):
    """Fill the association probabilities beta (track * model, 1 + measurement) and update mu and existence in place.

    Likelihoods p (track, model, measurement), 0 outside a gate; pd = Pd Pg (track,); density (track, measurement);
    own and claim (track, measurement) are scratch space. Only the first ``count`` measurements are used.
    """
    tracks, models = mu.shape
    for t in range(tracks):
        claims(t, p, mu, pd, existence, density, count, own, claim)
    for t in range(tracks):
        for i in range(count):  # own becomes Omega: clutter and the claims of the other tracks
            own[t, i] = density[t, i]
            for s in range(tracks):
                if s != t:
                    own[t, i] += claim[s, i]
        whole = 0.0
        for r in range(models):
            seen = 0.0
            for i in range(count):
                seen += p[t, r, i] / own[t, i]
            left = 1.0 - pd[t] + pd[t] * seen  # 1 - delta^(t,r)
            row = t * models + r
            beta[row, 0] = (1.0 - pd[t]) / left
            for i in range(count):
                beta[row, i + 1] = pd[t] * p[t, r, i] / own[t, i] / left
            mu[t, r] *= left
            whole += mu[t, r]  # 1 - delta^(t)
        for r in range(models):
            mu[t, r] /= whole
        existence[t] = whole * existence[t] / (1.0 - existence[t] + whole * existence[t])


@kernel
def lmipda(p, mu, pd, existence, density, beta):
    """``lmipda_one`` for a batch, all arrays with one flat leading axis; beta (env, track * model, 1 + measurement)."""
    own, claim = np.empty(density.shape[1:]), np.empty(density.shape[1:])
    for e in range(len(p)):
        lmipda_one(p[e], mu[e], pd[e], existence[e], density[e], p.shape[3], beta[e], own, claim)
