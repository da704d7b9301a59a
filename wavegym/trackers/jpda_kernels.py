"""Compiled joint probabilistic data association: one sensor's scan updates the targets of one environment.

The gain is G S^-1 with the cross-covariance G, for example from ``predict_measurement_one``. Arrays hold the targets of
one environment; ``t`` is the target.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.clutter_kernels import squared_distance
from wavegym.trackers.association_kernels import associate_one


@kernel
def weigh(z, count, centre, L, present, pd, gate, gate_probability, density, W):
    """Association weights W (present targets, 1 + scan) of the scan z[: count]; 0 outside a gate.

    Column 0 is a missed detection, 1 - Pd Pg; column m the m-th measurement, Pd N(z; centre, L L') / density.
    """
    row = 0
    for t in range(len(present)):
        if not present[t]:
            continue
        W[row, 0] = 1.0 - pd[t] * gate_probability
        peak = pd[t] / (2.0 * np.pi * L[t, 0, 0] * L[t, 1, 1] * density)
        for m in range(count):
            squared = squared_distance(t, z[m, 0], z[m, 1], centre, L)
            W[row, m + 1] = peak * np.exp(-0.5 * squared) if squared <= gate * gate else 0.0
        row += 1


@kernel
def update_targets(present, x, P, z, count, pd, centre, L, S, G, gate, gate_probability, density, nn):
    """Update all present targets by one sensor's scan z[: count] and return the log evidence of the scan.

    The predicted x (t, n) and P (t, n, n) are overwritten. centre (t, 2), S = L L' (t, 2, 2) and G (t, n, 2) are the
    predicted measurement, innovation covariance and cross-covariance; pd (t,).
    """
    rows = 0
    for t in range(len(present)):
        rows += present[t]
    W, beta = np.empty((rows, count + 1)), np.empty((rows, count + 1))
    weigh(z, count, centre, L, present, pd, gate, gate_probability, density, W)
    log_evidence = associate_one(W, rows, count, beta)
    K, row = np.empty((len(nn), 2)), 0
    for t in range(len(present)):
        if present[t]:
            update_one(t, x, P, z, count, beta, row, centre, S, G, K, nn)
            row += 1
    return log_evidence


@kernel
def update_one(t, x, P, z, count, beta, row, centre, S, G, K, nn):
    """Update x[t], P[t] by a scan with association probabilities beta[row] (1 + count); column 0 = missed.

    P - K [(1 - beta_0) S - (sum beta v v' - v v')] K' with the combined innovation v = sum beta_m v_m
    (Bar-Shalom & Fortmann 1988). S (t, 2, 2) is the innovation covariance; K (n, 2) is scratch space.
    """
    v0 = v1 = b00 = b01 = b11 = 0.0
    for m in range(count):
        b = beta[row, m + 1]
        if b > 0.0:
            d0, d1 = z[m, 0] - centre[t, 0], z[m, 1] - centre[t, 1]
            v0 += b * d0
            v1 += b * d1
            b00 += b * d0 * d0
            b01 += b * d0 * d1
            b11 += b * d1 * d1
    seen = 1.0 - beta[row, 0]
    c00 = seen * S[t, 0, 0] - (b00 - v0 * v0)
    c01 = seen * S[t, 0, 1] - (b01 - v0 * v1)
    c11 = seen * S[t, 1, 1] - (b11 - v1 * v1)
    gain_one(t, G, S, K, nn)
    for i in range(len(nn)):
        x[t, i] += K[i, 0] * v0 + K[i, 1] * v1
    shrink_one(t, P, K, c00, c01, c11, nn)


@kernel
def gain_one(t, G, S, K, nn):
    """K = G[t] S[t]^-1, (n, 2)."""
    determinant = S[t, 0, 0] * S[t, 1, 1] - S[t, 0, 1] * S[t, 0, 1]
    for i in range(len(nn)):
        K[i, 0] = (G[t, i, 0] * S[t, 1, 1] - G[t, i, 1] * S[t, 0, 1]) / determinant
        K[i, 1] = (G[t, i, 1] * S[t, 0, 0] - G[t, i, 0] * S[t, 0, 1]) / determinant


@kernel
def shrink_one(t, P, K, c00, c01, c11, nn):
    """P[t] - K [[c00, c01], [c01, c11]] K', symmetric to the last bit."""
    for i in range(len(nn)):
        u, v = K[i, 0] * c00 + K[i, 1] * c01, K[i, 0] * c01 + K[i, 1] * c11
        for j in range(i + 1):
            P[t, i, j] -= u * K[j, 0] + v * K[j, 1]
            P[t, j, i] = P[t, i, j]


@kernel
def jpda_update(x, P, z, centre, S, G, pd, density, gate, gate_probability, nn):
    """``update_targets`` for a batch, all arrays with one flat leading axis; x and P are overwritten."""
    targets = centre.shape[1]
    present, L = np.ones(targets, np.bool_), np.empty((targets, 2, 2))
    for e in range(len(x)):
        for t in range(targets):
            factor_one(t, S[e], L)
        update_targets(
            present, x[e], P[e], z[e], z.shape[1], pd[e], centre[e], L, S[e], G[e],
            gate, gate_probability, density[e], nn
        )  # fmt: skip


@inlined
def factor_one(t, S, L):
    """Lower triangular L[t] with L[t] L[t]' = S[t], (2, 2)."""
    L[t, 0, 0] = np.sqrt(S[t, 0, 0])
    L[t, 0, 1] = 0.0
    L[t, 1, 0] = S[t, 1, 0] / L[t, 0, 0]
    L[t, 1, 1] = np.sqrt(S[t, 1, 1] - L[t, 1, 0] * L[t, 1, 0])


GATE = 4.0  # of the table
LIMIT = 1.0 - (1.0 + GATE * GATE / 2.0) * np.exp(-GATE * GATE / 2.0)  # q2 / Pd without clutter


@kernel
def reduction_one(pd, log_clutter, pd_grid, log_clutter_grid, table):
    """q2 for one Pd and one log(rho V), V the volume of the gate g = 4, from the arrays of ``reduction_table()``.

    ``table`` holds log f of q2 = LIMIT Pd / (1 + f rho V / Pd) with f in [0.27, 2.7]. Between grid points log f is
    interpolated bilinearly; beyond the grid it is constant. So the formula has the right limits: LIMIT Pd without
    clutter and 2 Pd^2 / (rho V) in heavy clutter.
    """
    if not pd > 0.0:
        return 0.0 if pd == 0.0 else np.nan
    low, high = 0, len(pd_grid) - 1
    while high - low > 1:
        middle = (low + high) >> 1
        if pd < pd_grid[middle]:
            high = middle
        else:
            low = middle
    u = (pd - pd_grid[low]) / (pd_grid[high] - pd_grid[low])
    last = len(log_clutter_grid) - 1
    place = (log_clutter - log_clutter_grid[0]) * (last / (log_clutter_grid[last] - log_clutter_grid[0]))
    place = min(max(place, 0.0), float(last))
    k = min(int(place), last - 1)
    v = place - k
    left = table[low, k] + v * (table[low, k + 1] - table[low, k])
    right = table[high, k] + v * (table[high, k + 1] - table[high, k])
    return LIMIT * pd * pd / (pd + np.exp(log_clutter + left + u * (right - left)))


@kernel
def reduction(pd, clutter, pd_grid, log_clutter_grid, table):
    """``reduction_one`` for arrays of Pd and rho V, both (n,)."""
    out = np.empty(len(pd))
    for e in range(len(pd)):
        out[e] = reduction_one(pd[e], np.log(clutter[e]), pd_grid, log_clutter_grid, table)
    return out
