"""One step of the agile-clutter loop in plain NumPy, from the paper's equations and the law of a realised echo.

The draws of clutter and of realised echoes are shared with the package. Pd, the effective SNR and the density of false
returns are not: the first two come from the mixture of gamma laws, and the package interpolates tables of them.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tests.oracles import C as LIGHT
from wavegym.core.counter_rng_kernels import stream
from wavegym.sensors import detection_probability, echo_law, mean_inverse_detected_snr
from wavegym.sensors.clutter_kernels import add_clutter
from wavegym.sensors.detection_kernels import received_snr
from wavegym.trackers import information_reduction

LAWS = {  # frequency at the fraction u of the pulse, per sweep (Table 1, mended)
    "lfm": lambda u, _: u,
    "pfm": lambda u, kappa: u ** (kappa - 1),
    "hfm": lambda u, g: -g * (g + 1) / (g + u),
    "efm": lambda u, g: -np.exp(-u / g) / (1 - np.exp(-1 / g)),
}


def unit_covariance(kind, shape, duration, signed_sweep, fc=10.4e9, rise=0.05):
    """Gamma J^-1 Gamma' at unit SNR, J from the centred moments of time and frequency by quadrature (in durations)."""
    node, weight = np.polynomial.legendre.leggauss(80)
    edges = [0.0, rise, 1 - rise, 1.0]
    u = np.concatenate([a + (b - a) * (node + 1) / 2 for a, b in pairwise(edges)])
    share = np.concatenate([(b - a) / 2 * weight for a, b in pairwise(edges)])
    energy = share * np.minimum(np.minimum(u, 1 - u) / rise, 1.0) ** 2
    alpha2 = 1 / energy.sum()
    energy *= alpha2
    w = 2 * np.pi * signed_sweep * duration * LAWS[kind](u, shape)
    t, w = u - energy @ u, w - energy @ w
    J = np.array([[2 * alpha2 / rise + energy @ (w * w), -(energy @ (t * w))], [0.0, energy @ (t * t)]])
    J[1, 0] = J[0, 1]
    gamma = np.diag([LIGHT / 2 * duration, -LIGHT / (2 * fc) / (2 * np.pi * duration)])
    return gamma @ np.linalg.inv(J) @ gamma.T


def train_covariance(C, count, interval, fc=10.4e9):
    """C of a coherent train of pulses with C (2, 2) each and 1/count of the energy.

    Times of arrival vary between the pulses by interval^2 (count^2 - 1) / 12, which informs on Doppler alone.
    """
    J = np.linalg.inv(C)
    J[1, 1] += interval**2 * np.var(np.arange(count)) * (4 * np.pi * fc / LIGHT) ** 2
    return np.linalg.inv(J)


def measure(x, site):
    """h(x) = (r, rdot), receding positive."""
    d = x[:2] - site
    r = np.hypot(*d)
    return np.array([r, x[2:] @ d / r])


def unscented(x, P, site):
    """Mean, covariance and cross-covariance of h over 2 n points x +- sqrt(n) A_i of equal weight (kappa = 0)."""
    n = len(x)
    A = np.sqrt(n) * np.linalg.cholesky(P).T
    points = np.concatenate([x + A, x - A])
    images = np.array([measure(p, site) for p in points])
    z = images.mean(axis=0)
    return z, (images - z).T @ (images - z) / (2 * n), (points - x).T @ (images - z) / (2 * n)


def snr(system, r):
    """eta at range r."""
    return (system.reference_range / max(r, system.nearest_range)) ** 4


def assumed(system, eta):
    """(Pd, SNR of the mean covariance of a detected echo), as a tracker assumes them of a mean SNR."""
    if system.snr_law == "printed":
        return system.false_alarm ** (1 / (1 + eta)), eta
    law = eta, system.false_alarm, system.fluctuation
    return detection_probability(*law, searched=2), 1 / mean_inverse_detected_snr(*law, searched=2, least=1)


def realised(system, eta, key):
    """SNR of the echo that the world draws, 0 if it is not detected."""
    if system.snr_law == "printed":
        law = echo_law((system.false_alarm,), energy=1.0, realised=False)
    else:
        law = echo_law((system.false_alarm,), system.fluctuation, 2)
    return received_snr(eta, 0, key, law)


def density(system, C):
    """False returns per m and m/s: clutter, and (2 T - 1) Pf peaks of noise in 2 pi sqrt(det C) of the sent pulse."""
    whole = C(1e6)[1] if callable(C) else C
    peaks = (2 * np.log(1 / system.false_alarm) - 1) * system.false_alarm / (2 * np.pi * np.sqrt(np.linalg.det(whole)))
    return system.clutter_density + (0.0 if system.snr_law == "printed" else peaks)


def marginals(W):
    """(T, M+1) by a sum over all associations: a T-dimensional table in which infeasible ones are 0."""
    T, columns = W.shape
    table = np.ones((1,) * T)
    index = np.indices((columns,) * T, sparse=True)
    for t in range(T):
        table = table * W[t].reshape([-1 if s == t else 1 for s in range(T)])
        for s in range(t):
            table = np.where((index[s] == index[t]) & (index[t] > 0), 0.0, table)
    beta = [table.sum(axis=tuple(s for s in range(T) if s != t)) for t in range(T)]
    return np.array(beta) / table.sum()


class Step(NamedTuple):
    """After one step of one environment."""

    mean: np.ndarray
    covariance: np.ndarray
    outside: np.ndarray
    detections: int
    clutter: int


def transition(system):
    """F and Q of eq. (2)."""
    d = system.dt
    F = np.eye(4) + d * np.eye(4, k=2)
    block = np.array([[d**3 / 3, d**2 / 2], [d**2 / 2, d]])
    return F, system.q * np.kron(block, np.eye(2))


def present(system, k):
    """Which slots hold a target at step k."""
    return [birth < k <= birth + system.lifetime for birth in system.births]


def predicted(system, k, mean, covariance):
    """F x, F P F' + Q of the targets present at step k."""
    F, Q = transition(system)
    x, P = mean.copy(), covariance.copy()
    for t in np.flatnonzero(present(system, k)):
        x[t], P[t] = F @ x[t], F @ P[t] @ F.T + Q
    return x, P


def visible(C, r):
    """(share of the energy, C at unit SNR of the whole pulse) of a pulse's echo from range r; see ``seen``."""
    share, own = C(r) if callable(C) else (1.0, C)
    return (share, own) if share >= 0.02 else (0.0, own)


def seen(system, C, r):
    """(N, Pd) of a pulse's echo from range r; N is None where less than 2 % of its energy is visible.

    C (2, 2) at unit SNR, of a pulse that is never cut; or C(r), the visible share and C at unit SNR of the whole pulse.
    """
    share, own = visible(C, r)
    if share == 0.0:
        return None, 0.0
    pd, effective = assumed(system, share * snr(system, r))
    return own * share / effective, pd


def expected_scan(system, site, C, x, P, here):
    """Per target: predicted measurement, S = Pzz + N and Pd at the predicted range, cross-covariance.

    ``here`` no longer has the targets whose echo is predicted to be cut away.
    """
    z, S, G, pd = np.zeros((len(x), 2)), np.tile(np.eye(2), (len(x), 1, 1)), np.zeros((len(x), 4, 2)), np.zeros(len(x))
    for t in np.flatnonzero(here):
        z[t], S[t], G[t] = unscented(x[t], P[t], site)
        N, pd[t] = seen(system, C, z[t, 0])
        here[t] = N is not None
        S[t] = S[t] + (N if here[t] else 0.0)
    return z, S, G, pd


def distances(points, centre, S):
    """Squared Mahalanobis distances."""
    v = points - centre
    return np.einsum("ij,ij->i", v, np.linalg.solve(S, v.T).T)


def jpda(system, scan, x, P, z, S, G, pd, here, false):
    """The JPDA update of the targets present with the scan (m, 2), at the density ``false`` of false returns."""
    slots = np.flatnonzero(here)
    share = 1 - np.exp(-(system.gate**2) / 2)
    W = np.empty((len(slots), len(scan) + 1))
    for row, t in enumerate(slots):
        squared = distances(scan, z[t], S[t])
        peak = pd[t] / (2 * np.pi * np.sqrt(np.linalg.det(S[t])) * false)
        W[row] = [1 - pd[t] * share, *np.where(squared <= system.gate**2, peak * np.exp(-squared / 2), 0.0)]
    for t, beta in zip(slots, marginals(W), strict=True):
        K, v = np.linalg.solve(S[t], G[t].T).T, scan - z[t]
        mean = beta[1:] @ v
        spread = (beta[1:, None] * v).T @ v - np.outer(mean, mean)
        x[t] = x[t] + K @ mean
        P[t] = P[t] - (1 - beta[0]) * K @ S[t] @ K.T + K @ spread @ K.T


def echo_key(system, world, e, k, i, t):
    """Key of the draws of target t's echo at sensor i in step k; clutter and particles have the keys before."""
    of_step = np.uint64(stream(world.key[e], k))
    return np.uint64(stream(np.uint64(stream(of_step, 2 * len(system.sensors) + 1 + i)), t))


def false_returns(system, world, e, k, i, C, z, S, lit):
    """The false returns in the gates of sensor i, (m, 2)."""
    key = np.uint64(stream(np.uint64(stream(world.key[e], k)), i))
    L, empty = np.linalg.cholesky(S), np.empty((64, 2))
    false, count = add_clutter(key, z, L, lit, system.gate, density(system, C), empty, 0)
    return false[:count]


def received(system, world, e, k, i, site, C, truth, z, S, here, lit=None):
    """Returns inside a gate, number of detections, number of returns outside their own target's gate (target,).

    lit: targets with a gate, by default those that are here.
    """
    scan, outside, detections, lit = [], np.zeros(len(truth), int), 0, here if lit is None else lit
    for t in np.flatnonzero(here):
        h = measure(truth[t], site)
        share, own = visible(C, h[0])
        key = echo_key(system, world, e, k, i, t)
        eta = realised(system, share * snr(system, h[0]), key) if share > 0.0 else 0.0
        if eta > 0.0:
            detections += 1
            point = h + np.linalg.cholesky(own * share / eta) @ world.error[e, k - 1, i, t]
            inside = [lit[s] and distances(point[None], z[s], S[s])[0] <= system.gate**2 for s in range(len(truth))]
            outside[t] += lit[t] and not inside[t]
            if any(inside):
                scan.append(point)
    return scan, detections, outside


def step(system, world, e, belief, path, C):
    """One step of environment e: ``belief`` (mean, covariance, step), true paths (target, age, 4), C (sensor, 2, 2)."""
    k = int(belief.step[e]) + 1
    here = np.array(present(system, k))
    x, P = predicted(system, k, belief.mean[e], belief.covariance[e])
    truth = np.array([path[t, k - birth if here[t] else 0] for t, birth in enumerate(system.births)])
    outside, detections, clutter = np.zeros(len(x), int), 0, 0
    for i, site in enumerate(np.array(system.sensors)):
        lit = here.copy()
        z, S, G, pd = expected_scan(system, site, C[i], x, P, lit)
        scan, found, missed = received(system, world, e, k, i, site, C[i], truth, z, S, here, lit)
        false = false_returns(system, world, e, k, i, C[i], z, S, lit)
        if lit.any():
            jpda(system, np.array([*scan, *false]).reshape(-1, 2), x, P, z, S, G, pd, lit, density(system, C[i]))
        detections += found
        if i == 0 or system.counts_every_sensor:  # the first one illuminates all targets
            outside, clutter = outside + missed, clutter + len(false)
    for t, birth in enumerate(system.births):
        if k == birth:
            x[t] = system.starts[t] + np.sqrt(system.prior_variance) * world.start[e, t]
    return Step(x, P, outside, detections, clutter)


def predicted_after(system, step, mean, covariance, C, outcome=None):
    """Eqs. (13) and (14), mended: P - q2 Pxz (Pzz + N)^-1 Pxz', sensor after sensor; outcome (sensor, target) bool.

    The factor of a detection is q2 / Pd and that of a miss 0; their mean, with probability Pd of a detection, is q2.
    """
    here = np.array(present(system, step + 1))
    x, P = predicted(system, step + 1, mean, covariance)
    for i, site in enumerate(np.array(system.sensors)):
        lit = here.copy()
        _, S, G, pd = expected_scan(system, site, C[i], x, P, lit)
        for t in np.flatnonzero(lit):
            area = 16 * np.pi * np.sqrt(np.linalg.det(S[t]))
            q2 = information_reduction(pd[t], density(system, C[i]) * area)
            if outcome is not None:
                q2 = q2 / pd[t] if outcome[i, t] else 0.0
            P[t] = P[t] - q2 * G[t] @ np.linalg.solve(S[t], G[t].T)
    return x, P
