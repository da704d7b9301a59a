"""Predicted beliefs and information for settings of RF/EO platforms, in compiled form.

Shapes and arguments as in ``kernels.py``; c candidates.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.copy_kernels import copy_matrix, copy_vector
from wavegym.core.kernels import kernel
from wavegym.systems.rf_eo.look_kernels import (
    expected_innovation,
    gain_of,
    information_one,
    is_here,
    look_one,
    off_look,
    predicted_variance,
    seen_one,
    spread_of,
    view_all,
    width_of,
)
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one, shrink_one


@kernel
def predict_ahead(step, mean, P, F, Q, places, rules, stay, x, V, h, H, nn):
    """Predict all targets: mean x (t, n), covariance V (t, n, n), measurements h (t, a), Jacobians H (t, a, n).

    A target that is not in the scene one step ahead stays as it is; its range of -1 is too near to be measured.
    """
    T = np.empty((len(nn), len(nn)))
    for t in range(mean.shape[0]):
        if not is_here(t, step + 1, stay):
            copy_vector(mean[t], x[t])
            copy_matrix(P[t], V[t])
            h[t], H[t] = -1.0, 0.0
            continue
        predict_mean_one(t, mean, F, 0, x, nn)
        predict_covariance_one(t, P, F, Q, 0, T, V, nn)
        look_one(t, x, places, rules, h[t], H[t])


@kernel
def predict(step, mean, P, settings, F, Q, places, fence, rules, stay, x, P_out, nn):
    """Fill predicted means x (e, c, t, n) and updated covariances P_out (e, c, t, n, n); settings (e or 1, c, p, 4)."""
    (count, candidates, targets), n, platforms = x.shape[:3], len(nn), places.shape[0]
    variance, low, high = np.empty((platforms, 3)), np.empty((platforms, 3)), np.empty((platforms, 3))
    ahead, V, v = np.empty((targets, n)), np.empty((targets, n, n)), np.empty(n)
    h, H, spread, seen = np.empty((targets, 3 * platforms)), np.empty((targets, 3 * platforms, n)), 0.0, 1.0
    for e in range(count):
        predict_ahead(step[e], mean[e], P[e], F, Q, places, rules, stay, ahead, V, h, H, nn)
        own = settings[e if settings.shape[0] > 1 else 0]
        for c in range(candidates):
            view_all(c, own, rules, variance, low, high)
            out = P_out[e, c]
            for t in range(targets):
                copy_vector(ahead[t], x[e, c, t])
                copy_matrix(V[t], out[t])
                for turn in range(6 * platforms if rules.folding else 3 * platforms):
                    a = turn % (3 * platforms)
                    j, q = a // 3, a % 3
                    early = rules.folding and turn < 3 * platforms  # azimuths first, as in the tracker
                    if h[t, 3 * j] < rules.nearest or (rules.folding and early != (q == 2)):
                        continue
                    if rules.margin > 0.0:
                        spread = spread_of(q, t, V, H[t], a)
                    if rules.folding and q == 0:
                        r_variance, rdot_variance = spread_of(0, t, V, H[t], a), spread_of(1, t, V, H[t], a + 1)
                        seen = seen_one(h[t, a], h[t, a + 1], r_variance, rdot_variance, high, j, rules)
                    value = off_look(h[t, a], own[c, j, 3], q)
                    R = predicted_variance(value, spread, variance[j, q], low[j, q], high[j, q], q, fence, rules)
                    g = gain_of(q, t, out, H[t], a, v, nn)
                    s = expected_innovation(g, R, seen, width_of(q, high[j, q], rules))
                    shrink_one(t, out, v, s, nn)


@kernel
def information(step, mean, P, settings, F, Q, places, fence, rules, stay, out, nn):
    """out (e, c, t): tr(P C' R~^-1 C) of every target for settings (e or 1, c, p, 4)."""
    (count, candidates, targets), n, platforms = out.shape, len(nn), places.shape[0]
    variance, low, high = np.empty((platforms, 3)), np.empty((platforms, 3)), np.empty((platforms, 3))
    ahead, V = np.empty((targets, n)), np.empty((targets, n, n))
    h, H, off = np.empty((targets, 3 * platforms)), np.empty((targets, 3 * platforms, n)), np.empty(3 * platforms)
    for e in range(count):
        predict_ahead(step[e], mean[e], P[e], F, Q, places, rules, stay, ahead, V, h, H, nn)
        own = settings[e if settings.shape[0] > 1 else 0]
        for c in range(candidates):
            view_all(c, own, rules, variance, low, high)
            for t in range(targets):
                for a in range(len(off)):
                    off[a] = off_look(h[t, a], own[c, a // 3, 3], a % 3)
                out[e, c, t] = information_one(t, V, off, H[t], variance, low, high, fence, rules)
