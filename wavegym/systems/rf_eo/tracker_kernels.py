"""The tracker of the RF/EO platforms in compiled form: an extended Kalman filter that improves on its linearisation.

Shapes and arguments as in ``look_kernels.py``; ``i`` is the entry of the means x (i, n) and covariances P (i, n, n).
z and R (a,): measurements and the variances that the tracker assumes, infinite where nothing was received.

Where the second-order terms of a measurement are small over the spread of the prior, one linearisation is enough.
Otherwise the update iterates (Gauss-Newton). Where they are not small over the spread of the posterior either, as after
a range alone, the posterior bends: it is linearised by regression over its own spread.

What may be folded updates only where its fold is certain. A Gaussian cannot hold several folds: the moments of all
would lose the less probable ones at the next measurement, and with them the target.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.array_kernels import copy_matrix
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.folding_kernels import certain_reach, fold_pair_one, nearest_fold, nearest_pair, shifted
from wavegym.sensors.platform_kernels import polar as polar_quantities
from wavegym.sensors.platform_kernels import wrapped
from wavegym.systems.rf_eo.look_kernels import ALL, SURE, gain_of, look_one, look_polar, spread_of, width_of
from wavegym.trackers.kernels import correct_one, gain_one, shrink_one
from wavegym.trackers.sigma_point_kernels import regression_one, sigma_points_one

SECOND_ORDER = 0.1  # standard deviations: a greater linearisation error makes the update iterate
CONVERGED = 1e-3  # standard deviations: the iteration ends when the estimate moves by less


@inlined
def curved_one(i, x, P, h, R):
    """Whether the measurement's second-order terms matter over the prior's spread, so that the update has to iterate.

    For a displacement d across the line of sight, the second-order term of the range is d^2 / 2r, that of the azimuth
    d^2 / 2r^2, those of the range-rate d / r times the velocity's spread and d^2 / 2r^2 times the speed.
    """
    spread = P[i, 0, 0] + P[i, 2, 2]
    restless = P[i, 1, 1] + P[i, 3, 3]
    squared_speed = x[i, 1] * x[i, 1] + x[i, 3] * x[i, 3]
    most = SECOND_ORDER * SECOND_ORDER
    for j in range(h.shape[0] // 3):
        r = h[3 * j]
        bend = 0.5 * spread / r
        turn = bend / r
        if bend * bend > most * R[3 * j] or turn * turn > most * R[3 * j + 2]:
            return True
        if spread * restless / (r * r) + squared_speed * turn * turn > most * R[3 * j + 1]:
            return True
    return False


@inlined
def absorb_one(i, P, H, y, R, d, v, nn):
    """d (n,) = K y and P[i] = [P[i]^-1 + H' R^-1 H]^-1, one received row after another."""
    for k in range(len(nn)):
        d[k] = 0.0
    for j in range(R.shape[0] // 3):
        for q in range(3):
            a = 3 * j + q
            if R[a] < np.inf:
                s = gain_of(q, i, P, H, a, v, nn) + R[a]
                correct_one(d, H, a, v, s, y[a], nn)
                shrink_one(i, P, v, s, nn)


@inlined
def residual_one(z, h, y):
    """y (a,) = z - h, azimuths wrapped."""
    for j in range(h.shape[0] // 3):
        y[3 * j] = z[3 * j] - h[3 * j]
        y[3 * j + 1] = z[3 * j + 1] - h[3 * j + 1]
        y[3 * j + 2] = wrapped(z[3 * j + 2] - h[3 * j + 2])


@kernel
def iterate_one(i, x, P, z, R, h, H, places, rules, y, d, v, polar, nn):
    """Gauss-Newton update: linearise again at each new estimate, starting from the prediction x[i], P[i] with h, H.

    ``polar``: x[i] is the polar state about the first platform. Ends when the estimate moves by less than CONVERGED
    standard deviations, or after ``rules.iterations``.
    """
    n = len(nn)
    prior, at = P[i].copy(), x[i : i + 1].copy()
    for spent in range(1, rules.iterations + 1):
        copy_matrix(prior, P[i])
        absorb_one(i, P, H, y, R, d, v, nn)
        moved = 0.0
        for k in range(n):
            step = x[i, k] + d[k] - at[0, k]
            moved = max(moved, step * step / P[i, k, k])
            at[0, k] = x[i, k] + d[k]
        if moved < CONVERGED * CONVERGED or spent == rules.iterations:
            break
        if polar:
            look_polar(0, at, places, rules, h, H)
        else:
            look_one(0, at, places, rules, h, H)
        residual_one(z, h, y)
        for a in range(h.shape[0]):
            for k in range(n):
                y[a] += H[a, k] * (at[0, k] - x[i, k])
    for k in range(n):
        x[i, k] = at[0, k]


@inlined
def values_one(points, h, places, rules, values):
    """values (2 n, a): the quantities of every platform at the points (2 n, n); azimuths without a jump from h (a,)."""
    for k in range(points.shape[0]):
        for j in range(places.shape[0]):
            r, rdot, azimuth = polar_quantities(
                points[k, 0], points[k, 1], points[k, 2], points[k, 3],
                places[j, 0], places[j, 1], places[j, 2], rules.printed,
            )  # fmt: skip
            values[k, 3 * j], values[k, 3 * j + 1] = r, rdot
            values[k, 3 * j + 2] = h[3 * j + 2] + wrapped(azimuth - h[3 * j + 2])


@inlined
def whiten_one(values, R, C, H, y, rows):
    """Replace H (a, n) and y (a,) by C^-1 H and C^-1 y, C C' = diag(R) + the linearisation errors' covariance.

    C (a, a) is scratch space; rows of infinite R are left as they are.
    """
    half = values.shape[0] // 2
    for a in range(rows):
        if R[a] < np.inf:
            for b in range(a + 1):
                if R[b] < np.inf:
                    total = R[a] if a == b else 0.0
                    for k in range(half):
                        total += values[2 * k, a] * values[2 * k, b] / half
                    for k in range(b):
                        if R[k] < np.inf:
                            total -= C[a, k] * C[b, k]
                    C[a, b] = np.sqrt(total) if a == b else total / C[b, b]
            for b in range(a):
                if R[b] < np.inf:
                    y[a] -= C[a, b] * y[b]
                    for k in range(H.shape[1]):
                        H[a, k] -= C[a, b] * H[b, k]
            y[a] /= C[a, a]
            for k in range(H.shape[1]):
                H[a, k] /= C[a, a]


@kernel
def regress_one(i, x, P, prior_x, prior, z, R, h, H, places, rules, y, d, v, nn):
    """Posterior linearisation: improve the estimate x[i], P[i] of a posterior too wide for one tangent.

    Every pass replaces the measurement by its statistical linear regression over the posterior so far, whose errors
    count as measurement noise, and updates the prior prior_x (1, n), prior (n, n) anew. Garcia-Fernandez, Svensson,
    Morelande and Sarkka (2015), "Posterior linearization filter". Arguments as in ``iterate_one``.
    """
    n, rows = len(nn), h.shape[0]
    A, C, points, values = np.empty((n, n)), np.empty((rows, rows)), np.empty((2 * n, n)), np.empty((2 * n, rows))
    for _ in range(rules.iterations):
        sigma_points_one(i, x, P, A, points, nn)
        values_one(points, h, places, rules, values)
        for a in range(rows):
            h[a] = regression_one(a, values, A, H, nn)
        residual_one(z, h, y)
        for a in range(rows):
            for k in range(n):
                y[a] += H[a, k] * (x[i, k] - prior_x[0, k])
        whiten_one(values, R, C, H, y, rows)
        copy_matrix(prior, P[i])
        for k in range(n):
            d[k] = 0.0
        for a in range(rows):
            if R[a] < np.inf:
                s = gain_one(i, P, H, a, v, nn, ALL) + 1.0
                correct_one(d, H, a, v, s, y[a], nn)
                shrink_one(i, P, v, s, nn)
        moved = 0.0
        for k in range(n):
            step = prior_x[0, k] + d[k] - x[i, k]
            moved = max(moved, step * step / P[i, k, k])
            x[i, k] = prior_x[0, k] + d[k]
        if moved < CONVERGED * CONVERGED:
            break


@inlined
def update_one(i, x, P, z, R, h, H, y, d, v, nn):
    """Update the prediction x[i], P[i] with measurements z and variances R (a,); h, H: predicted ones and Jacobian."""
    residual_one(z, h, y)
    absorb_one(i, P, H, y, R, d, v, nn)
    for a in range(len(nn)):
        x[i, a] += d[a]


@kernel
def refine_one(i, x, P, z, R, h, H, places, rules, y, d, v, nn):
    """As ``update_one``, where one tangent misleads."""
    prior_x, prior = x[i : i + 1].copy(), P[i].copy()
    residual_one(z, h, y)
    iterate_one(i, x, P, z, R, h, H, places, rules, y, d, v, False, nn)
    if curved_one(i, x, P, h, R):
        regress_one(i, x, P, prior_x, prior, z, R, h, H, places, rules, y, d, v, nn)


@kernel
def fold_pair(P, H, z, h, R, high, j, rules, nn):
    """(range certain, its fold, range-rate certain, its fold) of platform j against the prediction h, P (1, n, n).

    A quantity is certain if all folds of the pair that are not exp(SURE^2 / 2) times less likely than the best share
    its fold: the spread over them is 0.
    """
    a, S01 = 3 * j, 0.0
    for k in range(len(nn)):
        for m in range(len(nn)):
            S01 += H[a, k] * P[0, k, m] * H[a + 1, m]
    S00, S11 = spread_of(0, 0, P, H, a) + R[a], spread_of(1, 0, P, H, a + 1) + R[a + 1]
    W0, W1 = width_of(0, high[j, 0], rules), width_of(1, high[j, 1], rules)
    least = nearest_pair(z[a] - h[a], z[a + 1] - h[a + 1], S00, S01, S11, W0, W1)[2]
    size = np.sqrt(least + SURE * SURE)
    found = fold_pair_one(z[a], z[a + 1], h[a], h[a + 1], S00, S01, S11, W0, W1, size, np.empty((0, 3)))
    return found[7] == 0.0, found[2], found[9] == 0.0, found[3]


@kernel
def unfold_one(i, P, z, R, h, H, high, rules, u, part, y, d, v, nn):
    """Fill u and part (a,), measurements without folds and their variances; infinite where the fold is not certain.

    Azimuths update a copy of the prediction P[i] first. Then a range or range-rate joins if all other folds are
    exp(SURE^2 / 2) times less likely than the nearest. Each narrows the prediction for the others, until no more is
    certain. high (p, 3): upper edges of the fields of view, which set the widths.
    """
    trial, at, fold = P[i : i + 1].copy(), h.copy(), np.zeros(2)
    certain = np.zeros(2, np.bool_)
    residual_one(z, h, y)
    for a in range(len(z)):
        u[a], part[a] = z[a], R[a] if a % 3 == 2 else np.inf
    absorb_one(0, trial, H, y, part, d, v, nn)
    changed = True
    while changed:
        changed = False
        for j in range(len(z) // 3):
            for a in range(3 * j, 3 * j + 2):
                at[a] = h[a]
                for k in range(len(nn)):
                    at[a] += H[a, k] * d[k]
            waits = R[3 * j] < np.inf and part[3 * j] == np.inf, R[3 * j + 1] < np.inf and part[3 * j + 1] == np.inf
            if waits[0] and waits[1]:
                certain[0], fold[0], certain[1], fold[1] = fold_pair(trial, H, z, at, R, high, j, rules, nn)
            for q in range(2):
                a = 3 * j + q
                if not waits[q]:
                    continue
                W = width_of(q, high[j, q], rules)
                if not waits[1 - q]:
                    fold[q] = nearest_fold(at[a] - z[a], W)
                    y0 = z[a] + shifted(fold[q], W) - at[a]
                    certain[q] = abs(y0) <= certain_reach(spread_of(q, 0, trial, H, a) + R[a], W, SURE)
                if certain[q]:
                    changed, part[a], u[a] = True, R[a], z[a] + shifted(fold[q], W)
                    s = gain_of(q, 0, trial, H, a, v, nn) + R[a]
                    correct_one(d, H, a, v, s, u[a] - h[a], nn)
                    shrink_one(0, trial, v, s, nn)
