"""O'Rourke and Swindlehurst's loop from the paper's equations, one environment at a time, its algebra to 80 digits.

The batch information form (11) is evaluated in long decimals, whose rounding is negligible: a difference of 1e-10 is
the rounding of the other side. Only h, the variances and the penalties are floats. Platforms' numbers are ordered
(platform, quantity), quantities range, range-rate, azimuth; ``p`` is a setting (PRF, B, alpha).
"""

from __future__ import annotations

from decimal import Decimal, getcontext
from typing import NamedTuple

import numpy as np
import oracles
from scipy.linalg import block_diag
from scipy.special import huber
from scipy.stats import norm

getcontext().prec = 80  # also where a narrow posterior is 1e-20 of a wide prior

LIGHT = oracles.C
STENCIL = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}  # central difference of eighth order


def wrap(angle):
    turn = 8 * np.arctan(np.ones_like(angle))
    return angle - turn * np.round(angle / turn)


def measure(system, x, j):
    """h_j(x), equations (4), (5) and eta with their corrections, or as printed; azimuth off the look direction."""
    look = system.looks[j] if len(system.looks) else 0.0
    dx, dy = x[0] - system.platforms[j][0], x[2] - system.platforms[j][1]
    r = np.sqrt(dx * dx + dy * dy)
    if system.as_printed:
        return np.array([r, (x[1] * dx - x[3] * dy) / r, wrap(np.arcsin(dx / r) - look)])
    return np.array([r, (x[1] * dx + x[3] * dy) / r, wrap(np.arctan2(dx, dy) - look)])


def jacobian(system, x, j):
    """dh_j/dx (3, 4) by differences in extended precision over 0.0004 of the range: errors about 1e-14."""
    x, columns = np.asarray(x, np.longdouble), []
    scale = np.hypot(x[0] - system.platforms[j][0], x[2] - system.platforms[j][1])
    for i, width in enumerate((scale / 1e4, 1.0, scale / 1e4, 1.0)):
        slope = 0.0
        for k, weight in STENCIL.items():
            step = np.zeros(4, np.longdouble)
            step[i] = k * width
            change = measure(system, x + step, j) - measure(system, x - step, j)
            change[2] = wrap(change[2])
            slope = slope + np.longdouble(weight) * change / width
        columns.append(slope)
    return np.array(columns, float).T


def stacked(system, x):
    """h and C of all platforms at x: (platform, 3) and (platform, 3, 4)."""
    every = range(len(system.platforms))
    return np.array([measure(system, x, j) for j in every]), np.array([jacobian(system, x, j) for j in every])


def plain_variances(system, p):
    """Uniform errors over one cell each: of range, of Doppler, of a pixel (section V)."""
    prf, bandwidth, alpha = p
    wavelength = LIGHT / system.carrier_hz
    cells = np.array([LIGHT / (2 * bandwidth), wavelength * prf / (2 * system.fft_length), alpha])
    return cells**2 / 12


def field_of_view(system, p):
    """Lower and upper edges, equations (14a), (14b) exchanged and made two-sided, or as printed, and (15)."""
    prf, _, alpha = p
    wavelength, half = LIGHT / system.carrier_hz, system.pixels * alpha / 2
    half = np.inf if half > np.pi * (1 - 1e-9) else half  # a full circle has no edge to leave
    if system.as_printed:
        return np.array([-np.inf, 0.0, -half]), np.array([wavelength * prf / 2, LIGHT / (2 * prf), half])
    high = np.array([LIGHT / (2 * prf), wavelength * prf / 4, half])
    return np.array([-np.inf, -high[1], -half]), high


def penalty(kind, x, low, high, sharpness, gamma):
    """phi(x) of the interval [low, high]: (13) on both sides, and the shapes that the paper names."""
    if high == np.inf:
        return 0.0
    if kind == "hard":
        return gamma if x > high or x < low else 0.0
    if kind == "log-barrier":
        inside = low <= x and abs(x) < high
        return min(gamma, -gamma / sharpness * np.log1p(-((x / high) ** 2))) if inside else gamma
    nu, beyond = sharpness / high, (x - high, low - x)
    if kind == "deadzone":
        return gamma * nu * sum(max(0.0, d) for d in beyond)
    if kind == "huber":
        return gamma * sum(huber(1.0, max(0.0, nu * d)) for d in beyond)
    return gamma * sum(np.exp(-np.logaddexp(0.0, -2 * nu * d)) for d in beyond)


def sharpness_of(system):
    if system.sharpness is None:
        return (1e8 if system.penalty == "log-barrier" else 100.0,) * 3
    return system.sharpness


def penalties(system, q, p, reach=(0.0, 0.0, 0.0)):
    """The penalties of one platform that measures q (3,) with setting p: the worse of those at q +- reach."""
    edges = zip(*field_of_view(system, p), strict=True)
    rest = list(zip(edges, sharpness_of(system), system.height, strict=True))
    points = (q + np.array(reach), q - np.array(reach))
    both = [
        [penalty(system.penalty, x, *e, s, g) for x, (e, s, g) in zip(point, rest, strict=True)] for point in points
    ]
    return np.max(both, axis=0)


def exact(a):
    """An array of floats as decimals; a float is one exactly."""
    return np.vectorize(Decimal.from_float, otypes=[object])(np.asarray(a, float))


def inverse(A):
    """Gauss and Jordan's, of a matrix of decimals."""
    n = len(A)
    work = np.hstack([A, exact(np.eye(n))])
    for i in range(n):
        pivot = next(k for k in range(i, n) if work[k, i] != 0)
        work[[i, pivot]] = work[[pivot, i]]
        work[i] = work[i] / work[i, i]
        for k in set(range(n)) - {i}:
            work[k] = work[k] - work[k, i] * work[i]
    return work[:, n:]


def information(C, R):
    """C' R^-1 C in decimals, of rows C (m, 4) with independent errors of variances R (m,)."""
    return exact(C).T @ (exact(C) / exact(R)[:, None])


def posterior(P, C, R):
    """[P^-1 + C' R^-1 C]^-1 (11), in decimals."""
    return inverse(inverse(exact(P)) + information(C, R))


def predict(system, x, P):
    """Equations (8) and (9), rounded once."""
    F, Q = (block_diag(A, A) for A in oracles.motion(2, system.dt, system.q))
    F = exact(F)
    return (F @ exact(x)).astype(float), (F @ exact(P) @ F.T + exact(Q)).astype(float)


class Foreseen(NamedTuple):
    """The prediction of one target under one setting."""

    mean: np.ndarray  # (4,)
    covariance: np.ndarray  # (4, 4) after the measurement
    share: float  # tr(P_{k+1|k} C' R~^-1 C)


def expected(system, x, P, settings):
    """Prediction (4,), (4, 4), its rows C (m, 4) and R~ (m,) at the predicted measurement (section III)."""
    x, P = predict(system, x, P)
    h, C = stacked(system, x)
    R = np.empty(h.shape)
    for j, p in enumerate(settings):
        reach = system.margin * np.sqrt(np.einsum("ma,ab,mb->m", C[j], P, C[j]))
        R[j] = plain_variances(system, p) + penalties(system, h[j], p, reach)
    far = h[:, 0] >= system.nearest_range
    return x, P, C[far].reshape(-1, 4), R[far].ravel()


def widths_of(system, p):
    """c / (2 PRF) and lambda PRF / 2, the intervals in which range and range-rate fold."""
    return LIGHT / (2 * p[0]), LIGHT / system.carrier_hz * p[0] / 2


def hidden_zones(system, p):
    """Half widths of what is not seen around whole intervals: half a pulse's length, and the notch."""
    return LIGHT * system.duty / p[0] / 2, system.notch


def outside(mean, sigma, width, half):
    """The probability that a Gaussian is farther than ``half`` from every multiple of ``width``."""
    centres = width * (np.round(mean / width) + np.arange(-300, 301))
    return 1 - (norm.cdf((centres + half - mean) / sigma) - norm.cdf((centres - half - mean) / sigma)).sum()


def single_fold(s, width):
    """The probability that the nearest fold is e^12.5 times as likely as the next: (W - |y|)^2 - y^2 > 25 s."""
    return max(0.0, 2 * norm.cdf((width - 25 * s / width) / 2 / np.sqrt(s)) - 1)


def predict_folded(system, x, P, settings):
    """The expected covariance, row by row: a row counts where it is seen and its fold is certain."""
    x, P = predict(system, x, P)
    h, C = stacked(system, x)
    prior, share, rows = P.copy(), 0.0, []
    for j, p in enumerate(settings):
        if h[j, 0] < system.nearest_range:
            continue
        spread = np.einsum("qa,ab,qb->q", C[j], prior, C[j])
        R = plain_variances(system, p)
        R[2] += penalties(system, h[j], p, system.margin * np.sqrt(spread))[2]
        seen = 1.0
        for q, (width, half) in enumerate(zip(widths_of(system, p), hidden_zones(system, p), strict=True)):
            seen *= outside(h[j, q], np.sqrt(spread[q]), width, half)
        for q, width in enumerate((*widths_of(system, p), np.inf)):
            certain = seen if q < 2 else 1.0
            rows.append((q < 2, C[j, q], R[q], certain, width))
            used = certain * single_fold(spread[q] + R[q], width)
            share += used * spread[q] / (spread[q] + R[q] - used * spread[q])
    for _, row, R, certain, width in sorted(rows, key=lambda r: r[0]):  # azimuths first
        v = P @ row
        s = row @ v + R
        P = P - certain * single_fold(s, width) * np.outer(v, v) / s
    return Foreseen(x, P, share)


def likely_folds(z, h, S, widths, most=40):
    """Fold numbers (n, m) of a quantity or a pair, of all hypotheses down to e^-12.5 of the best one's likelihood."""
    centre = [round(float((b - a) / w)) for a, b, w in zip(z, h, widths, strict=True)]
    grids = np.meshgrid(*(c + np.arange(-most, most + 1) for c in centre), indexing="ij")
    numbers = np.stack([g.ravel() for g in grids], axis=1)
    y = z + numbers * np.asarray(widths) - h
    distance = np.einsum("na,ab,nb->n", y, np.linalg.inv(S), y)
    return numbers[distance - distance.min() <= 25.0]


def unfold(system, x, P, readings, R, settings):
    """Readings without folds, NaN where a fold is not certain: all hypotheses are listed, and share it or not.

    Azimuths count first; what is certain narrows the prediction, by whole matrices, until nothing more is.
    """
    h, C = stacked(system, x)
    got = np.where(np.arange(3) == 2, readings, np.nan)
    while True:
        before = got.copy()
        for j, p in enumerate(settings):
            mean, cov = gauss_newton(system, x, P, got, R, 1)
            waits = [q for q in range(2) if np.isnan(got[j, q]) and not np.isnan(readings[j, q])]
            if not waits:
                continue
            at, rows = h[j, waits] + C[j, waits] @ (mean - x), C[j, waits]
            widths = np.array(widths_of(system, p))[waits]
            numbers = likely_folds(readings[j, waits], at, rows @ cov @ rows.T + np.diag(R[j, waits]), widths)
            for column, q in enumerate(waits):
                if (numbers[:, column] == numbers[0, column]).all():
                    got[j, q] = readings[j, q] + numbers[0, column] * widths[column]
        if np.array_equal(before, got, equal_nan=True):
            return got


def predict_ahead(system, x, P, settings):
    """The prediction of one target under settings."""
    if system.folding:
        return predict_folded(system, x, P, settings)
    x, P, C, R = expected(system, x, P, settings)
    return Foreseen(x, posterior(P, C, R).astype(float), float(np.trace(exact(P) @ information(C, R))))


def weighted_eigenvalues(system, x, P, settings):
    """Eigenvalues t of P_{k+1|k} M, M = C' R~^-1 C: the objective is their sum, its aim the sum of log(1 + t)."""
    _, P, C, R = expected(system, x, P, settings)
    rows = C @ np.linalg.cholesky(P) / np.sqrt(R)[:, None]
    return np.linalg.svd(rows, compute_uv=False) ** 2


def gauss_newton(system, x, P, readings, R, iterations, small=0.0):
    """Iterated update by whole matrices: x_{i+1} = x + P+ C_i' R^-1 (y - h(x_i) - C_i (x - x_i)), x_0 = x.

    Readings and R are (platform, 3), missing ones NaN. Stops at a step of at most ``small`` deviations of P+.
    One iteration is (10) and (11).
    """
    seen, point, cov = ~np.isnan(readings), np.asarray(x, float), P
    if not seen.any():
        return point, np.asarray(P, float)
    for _ in range(iterations):
        h, C = stacked(system, point)
        innovation = readings - h
        innovation[:, 2] = wrap(innovation[:, 2])
        C = C[seen]
        cov = posterior(P, C, R[seen])
        linear = exact(innovation[seen]) - exact(C) @ (exact(x) - exact(point))
        new = (exact(x) + cov @ (exact(C).T @ (linear / exact(R[seen])))).astype(float)
        moved = np.abs(new - point) / np.sqrt(np.diag(cov).astype(float))
        point = new
        if moved.max() <= small:
            break
    return point, cov.astype(float)


def bends(x, P, h, R, limit=0.1):
    """Whether the linearisation error of h over the prior's spread d exceeds ``limit`` deviations of any reading.

    Range d^2 / 2r; azimuth d^2 / 2r^2; range-rate d sigma_v / r + speed d^2 / 2r^2. R (platform, 3), NaN where missing.
    """
    d2, sigma_v, speed = P[0, 0] + P[2, 2], np.sqrt(P[1, 1] + P[3, 3]), np.hypot(x[1], x[3])
    r = h[:, 0]
    left = np.array([d2 / (2 * r), np.sqrt(d2) * sigma_v / r + speed * d2 / (2 * r**2), d2 / (2 * r**2)]).T
    return bool((left / np.sqrt(R) > limit).any())  # NaN is no


class Step(NamedTuple):
    """One target after one step."""

    truth: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    received: int
    regressed: bool  # computed in doubles


def regressed(system, x, P, readings, R, point, cov, small):
    """Posterior linearisation from the estimate ``point``, ``cov`` on: repeated regression, in doubles.

    Readings and R are (platform, 3), missing ones NaN. The linearisation errors of all readings together are noise.
    """
    seen = ~np.isnan(readings)
    for _ in range(system.iterations):
        spread = 2 * np.linalg.cholesky(cov)
        points = point + np.concatenate([spread.T, -spread.T])
        values = np.array([stacked(system, at)[0] for at in points])
        values[..., 2] = readings[:, 2] + wrap(values[..., 2] - readings[:, 2])
        values = values[:, seen]
        middle = values.mean(axis=0)
        slope = np.linalg.solve(spread.T, (values[:4] - values[4:]) / 2).T
        left = (values[:4] + values[4:]) / 2 - middle
        noise = np.diag(R[seen]) + left.T @ left / 4
        innovation = readings[seen] - middle - slope @ (x - point)
        gain = P @ slope.T @ np.linalg.inv(slope @ P @ slope.T + noise)
        new, short = x + gain @ innovation, np.eye(4) - gain @ slope
        cov = short @ P @ short.T + gain @ noise @ gain.T
        moved, point = np.abs(new - point) / np.sqrt(np.diag(cov)), new
        if moved.max() <= small:
            break
    return point, cov


def move(system, truth, draw):
    """x' = F x + L w with L the Cholesky factor of Q."""
    F, Q = (block_diag(A, A) for A in oracles.motion(2, system.dt, system.q))
    return F @ truth + np.linalg.cholesky(Q) @ draw


def readings_of(system, truth, predicted, settings, error):
    """The measurements of one target (platform, 3) that the tracker uses, NaN where none, and their variances.

    A platform nearer than ``nearest_range`` sends nothing, one that is predicted there is not believed.
    """
    y, R = np.full(error.shape, np.nan), np.empty(error.shape)
    for j, p in enumerate(settings):
        q, plain = measure(system, truth, j), plain_variances(system, p)
        low, high = field_of_view(system, p)
        sent, R[j], there = plain, plain, (low <= q) & (q <= high)
        if system.out_of_view == "inflated":
            sent, there = plain + penalties(system, q, p), np.full(3, True)
            R[j] = plain + penalties(system, measure(system, predicted, j), p)
        value = q + np.sqrt(sent) * error[j]
        if system.folding:
            widths, halves = widths_of(system, p), hidden_zones(system, p)
            off = [abs(a - w * round(a / w)) for a, w in zip(q, widths, strict=False)]
            there[:2] = all(d >= half for d, half in zip(off, halves, strict=True))
            value[0] %= widths[0]
            value[1] = (value[1] + widths[1] / 2) % widths[1] - widths[1] / 2
        if min(q[0], measure(system, predicted, j)[0]) >= system.nearest_range:
            y[j] = np.where(there, value, np.nan)
    return y, R


def step(system, truth, x, P, settings, process, error):
    """One closed-loop step of one target; ``process`` (4,) and ``error`` (platform, 3) are its standard normals.

    The update is iterated until a step is below 0.001 deviations where the measurement ``bends``, and ``regressed``
    where it bends over the posterior too.
    """
    truth, (x, P) = move(system, truth, process), predict(system, x, P)
    y, R = readings_of(system, truth, x, settings, error)
    received = int((~np.isnan(y)).sum())
    if system.folding:
        y = unfold(system, x, P, y, R, settings)
    used = np.where(np.isnan(y), np.nan, R)
    again = system.iterations > 1 and bends(x, P, stacked(system, x)[0], used)
    mean, cov = gauss_newton(system, x, P, y, R, system.iterations if again else 1, 1e-3)
    still = again and bends(mean, cov, stacked(system, mean)[0], used)
    if still:
        mean, cov = regressed(system, x, P, y, R, mean, cov, 1e-3)
    return Step(truth, mean, cov, received, still)


def nees(truth, mean, P):
    e = exact(truth) - exact(mean)
    return float(e @ inverse(exact(P)) @ e)


def cost(system, covariance):
    """Sum over targets of trace(W P)."""
    return sum(float(np.trace(np.diag(system.weights) @ P)) for P in covariance)
