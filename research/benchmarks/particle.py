"""A step of the particle filter (RBPF) against the same algorithm in NumPy with filterpy's resampling.

The peer is written for speed: all particles and sigma points at once, two-by-two matrices and the sum over the
associations of two targets in closed form, particles on the last axis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from filterpy.monte_carlo import systematic_resample

from research.benchmarks.timing import Ratio, compare
from wavegym.trackers import rbpf_kernels as kernels

PARTICLES, PD, DENSITY, GATE, PG = 1000, 0.9, 1e-4, 4.0, 0.9997
SENSORS = np.array([[3000.0, -16000.0], [3000.0, 20400.0]])
NOISE = np.array([[100.0, 3.0], [3.0, 9.0]])
F = np.kron([[1.0, 0.25], [0.0, 1.0]], np.eye(2))
Q = np.kron([[0.25**3 / 3, 0.25**2 / 2], [0.25**2 / 2, 0.25]], np.eye(2))


class Problem(NamedTuple):
    """Particles of two targets close together; two sensors with four returns each."""

    X: np.ndarray  # (particle, target, 4)
    V: np.ndarray  # (particle, target, 4, 4)
    scans: list[np.ndarray]  # each (4, 2)
    gates: list[tuple]  # of each sensor: centre (target, 2), L (target, 2, 2), radius, gate probability


def problem(seed: int = 0) -> Problem:
    """Each target's return and two clutter points per sensor, inside overlapping gates."""
    rng = np.random.default_rng(seed)
    truth = np.array([[2000.0, -1000.0, -100.0, 800.0], [2040.0, -980.0, -95.0, 790.0]])
    X = truth + rng.standard_normal((PARTICLES, 2, 4)) * [10.0, 10.0, 2.0, 2.0]
    V, scans, gates = np.tile(np.diag([900.0, 900.0, 25.0, 25.0]), (PARTICLES, 2, 1, 1)), [], []
    wide = (F @ np.diag([1000.0, 1000.0, 29.0, 29.0]) @ F.T + Q)[:, :, None, None].repeat(2, axis=2)
    for sensor in SENSORS:
        offset, v = (truth @ F.T)[:, :2] - sensor, truth[:, 2:]
        r = np.hypot(*offset.T)
        z = np.stack([r, (offset * v).sum(1) / r], axis=1)
        z = z.repeat(2, axis=0) + rng.multivariate_normal([0.0, 0.0], NOISE, 4)
        z[1::2] += rng.uniform(-1.0, 1.0, (2, 2)) * [40.0, 12.0]  # clutter
        scans.append(z)
        centre, (l00, l10, l11), _ = predict_ahead((F @ truth.T)[:, :, None], wide, sensor)
        L = np.array([[l00, 0.0 * l00], [l10, l11]])[..., 0].transpose(2, 0, 1)
        gates.append((centre[..., 0].T.copy(), L.copy(), GATE, PG))
    return Problem(X, V, scans, gates)


def ours(p: Problem, repeats: int) -> int:
    """The step by wavegym: predict, update with both sensors, moments, resample."""
    present, pd, noise, nn = np.ones(2, bool), np.full(2, PD), np.tile(NOISE, (2, 1, 1)), (0,) * 4
    X, V, Y, U = (np.empty(a.shape) for a in (p.X, p.V, p.X, p.V))
    weight, mean, covariance = np.empty(PARTICLES), np.empty((2, 4)), np.empty((2, 4, 4))
    for k in range(repeats):
        kernels.predict_particles(p.X, p.V, present, F[None], Q[None], X, V, nn)
        log_weight = np.zeros(PARTICLES)
        for i, z in enumerate(p.scans):
            key = np.uint64(3 * k + i)
            kernels.update_particles(
                key, present, X, V, log_weight, z, len(z), pd, noise, *SENSORS[i], p.gates[i], DENSITY, nn
            )
        kernels.normalise(log_weight, weight)
        kernels.mixture(weight, X, V, present, mean, covariance, nn)
        kernels.resample(np.uint64(3 * k + 2), weight, X, V, Y, U, nn)
    return repeats


def sigma_points(x: np.ndarray, P: np.ndarray) -> np.ndarray:
    """x +- 2 A_i with A A' = P: (8, 4, target, particle); the points + and - of an axis are four apart."""
    A, root = np.zeros(P.shape), np.empty(x.shape[1:])
    for i in range(4):
        for j in range(i):
            A[i, j] = (P[i, j] - (A[i, :j] * A[j, :j]).sum(0)) / A[j, j]
        A[i, i] = np.sqrt(P[i, i] - (A[i, :i] * A[i, :i]).sum(0), out=root)
    spread = 2.0 * A.swapaxes(0, 1)
    return np.concatenate([x + spread, x - spread])


def predict_ahead(x: np.ndarray, P: np.ndarray, sensor: np.ndarray) -> tuple[np.ndarray, ...]:
    """Unscented: predicted measurement (2, target, particle), S = L L' as (l00, l10, l11), cov(x, z) (4, 2, ...)."""
    points = sigma_points(x, P)
    d0, d1 = points[:, 0] - sensor[0], points[:, 1] - sensor[1]
    r = np.sqrt(d0 * d0 + d1 * d1)
    images = np.stack([r, (d0 * points[:, 2] + d1 * points[:, 3]) / r])
    z = images.mean(1)
    images -= z[:, None]
    s00, s10, s11 = ((images[a] * images[b]).mean(0) + NOISE[a, b] for a, b in ((0, 0), (1, 0), (1, 1)))
    half = points[:4] - x  # the images of opposite points have opposite signs
    G = np.einsum("piTj,mpTj->imTj", half, images[:, :4] - images[:, 4:]) / 8.0
    l00 = np.sqrt(s00)
    l10 = s10 / l00
    return z, np.stack([l00, l10, np.sqrt(s11 - l10 * l10)]), G


def draw(W: np.ndarray, u: np.ndarray) -> np.ndarray:
    """A row (0 .. M) of W (M+1, particle) for each particle, in proportion."""
    reached = np.cumsum(W, axis=0)
    return (u * reached[-1] >= reached).sum(0)


def received(z: np.ndarray, gates: tuple) -> np.ndarray:
    """The gate probability where z (2, target, particle) lies in one of the gates, else 0."""
    (c0, c1), L = gates[0].T[:, :, None, None], gates[1][..., None, None]
    a = (z[0] - c0) / L[:, 0, 0]
    b = (z[1] - c1 - L[:, 1, 0] * a) / L[:, 1, 1]
    return PG * (a * a + b * b <= GATE * GATE).any(0)


def peer_update(
    x: np.ndarray, P: np.ndarray, z: np.ndarray, sensor: np.ndarray, gates: tuple, u: np.ndarray
) -> np.ndarray:
    """One scan for x (4, target, particle), P (4, 4, target, particle), in place; log evidence (particle,)."""
    centre, (l00, l10, l11), G = predict_ahead(x, P, sensor)
    a = (z[:, 0, None, None] - centre[0]) / l00  # (measurement, target, particle)
    b = (z[:, 1, None, None] - centre[1] - l10 * a) / l11
    W = np.empty((len(z) + 1, *a.shape[1:]))
    W[0] = 1.0 - PD * received(centre, gates)
    W[1:] = PD / (2.0 * np.pi * DENSITY * l00 * l11) * np.exp(-0.5 * (a * a + b * b))
    total = W.sum(0)
    beside = total[0] - W[:, 0]  # sum over target 0 where target 1 has measurement m
    beside[0] = total[0]
    second = W[:, 1] * beside
    evidence = second.sum(0)
    owner = np.empty(a.shape[1:], np.int64)
    owner[1] = draw(second, u[1])
    first, particle = W[:, 0].copy(), np.arange(a.shape[2])
    taken = owner[1] > 0
    first[owner[1, taken], particle[taken]] = 0.0
    owner[0] = draw(first, u[0])
    seen, m = owner > 0, np.maximum(owner - 1, 0)[None]
    a, b = (np.take_along_axis(w, m, axis=0)[0] for w in (a, b))
    U0 = seen * G[:, 0] / l00
    U1 = (seen * G[:, 1] - l10 * U0) / l11
    x += U0 * a + U1 * b
    P -= U0[:, None] * U0 + U1[:, None] * U1
    return np.log(evidence)


def peer(x: np.ndarray, P: np.ndarray, p: Problem, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """The same step by the peer: moments, and resampled particles."""
    x = (F @ x.reshape(4, -1)).reshape(x.shape)
    P = (F @ P.reshape(4, -1)).reshape(P.shape).swapaxes(0, 1)  # F P, then its transpose
    P = (F @ P.reshape(4, -1)).reshape(P.shape) + Q[:, :, None, None]
    log_weight = np.zeros(x.shape[2])
    for sensor, z, gates in zip(SENSORS, p.scans, p.gates, strict=True):
        log_weight += peer_update(x, P, z, sensor, gates, rng.random((2, x.shape[2])))
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = x @ weight
    d = x - mean[:, :, None]
    covariance = P @ weight + np.matmul((d * weight).transpose(1, 0, 2), d.transpose(1, 2, 0)).transpose(1, 2, 0)
    index = systematic_resample(weight)
    return mean, covariance, x[:, :, index], P[:, :, :, index]


def particles_last(p: Problem) -> tuple[np.ndarray, np.ndarray]:
    """The peer's arrays: x (4, target, particle), P (4, 4, target, particle)."""
    return np.ascontiguousarray(p.X.transpose(2, 1, 0)), np.ascontiguousarray(p.V.transpose(2, 3, 1, 0))


def peers(p: Problem, repeats: int) -> int:
    rng, (x, P) = np.random.default_rng(0), particles_last(p)
    for _ in range(repeats):
        peer(x, P, p, rng)
    return repeats


def check(p: Problem) -> None:
    """Check that both sides give each particle the same evidence of a scan."""
    x, P = particles_last(p)
    theirs = peer_update(x, P, p.scans[0], SENSORS[0], p.gates[0], np.full((2, PARTICLES), 0.5))
    ours, noise, pd = np.zeros(PARTICLES), np.tile(NOISE, (2, 1, 1)), np.full(2, PD)
    kernels.update_particles(
        np.uint64(0), np.ones(2, bool), p.X.copy(), p.V.copy(), ours, p.scans[0], len(p.scans[0]), pd, noise,
        *SENSORS[0], p.gates[0], DENSITY, (0,) * 4
    )  # fmt: skip
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-6)


def run() -> dict[str, tuple[Ratio, float | None]]:
    """Each ratio with its target, if any."""
    p = problem()
    check(p)
    name = f"particle filter step, 2 targets x {PARTICLES} particles, 2 sensors x 4 returns"
    return {name: (compare(lambda: ours(p, 200), lambda: peers(p, 50)), 2.5)}
