"""One step of the sector-setup loop in plain NumPy: full matrices, Joseph's form, Jacobians by complex steps.

Posterior linearisation as its paper has it (moments of the points, no shortcut for the residual), with the diagonal of
the residual's covariance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from tests.oracles import motion, predict, update


class Step(NamedTuple):
    """After one step of one environment."""

    mean: np.ndarray  # (target, 4)
    covariance: np.ndarray
    truth: np.ndarray
    pointed: int
    dead: int
    detections: int


def model(system, q, seconds=None):
    """F and Q of [x xdot y ydot]; F is the exponential of the turning motion's generator."""
    seconds = system.dt if seconds is None else seconds
    turn = np.array([[0.0, -system.turn_rate], [system.turn_rate, 0.0]])
    generator = np.kron(np.eye(2), [[0.0, 1.0], [0.0, 0.0]]) + np.kron(turn, np.diag([0.0, 1.0]))
    return expm(seconds * generator), np.kron(np.eye(2), motion(2, seconds, q)[1])


def measure(system, x):
    """(half the path, its rate) at each receiver, and the SNR there; x may be complex."""
    z, eta = [], []
    for receiver in system.receivers:
        legs = [x[[0, 2]] - np.array(site) for site in (system.illuminator, receiver)]
        lengths = [np.sqrt((leg * leg).sum()) for leg in legs]
        rates = [(leg * x[[1, 3]]).sum() / r for leg, r in zip(legs, lengths, strict=True)]
        z.append([sum(lengths) / 2, sum(rates) / 2])
        held = [max(r.real, system.nearest_range) for r in lengths]
        eta.append(system.reference_snr * system.reference_range**4 / (held[0] ** 2 * held[1] ** 2))
    return np.array(z), np.array(eta)


def jacobian(system, x):
    """(receiver, 2, 4), exact to rounding: the imaginary part of h(x + j 1e-30 e_i)."""
    rows = [measure(system, x + 1e-30j * unit)[0].imag / 1e-30 for unit in np.eye(4)]
    return np.moveaxis(np.array(rows), 0, -1)


def detection(system, eta):
    return system.false_alarm ** (1 / (1 + eta / 2))


def noise(system, waveform, eta):
    return np.square(system.waveforms[waveform]) * system.reference_snr / eta


def curved(system, mean, covariance, waveform, seen):
    """Whether a seen quantity's second-order terms over the prior's spread exceed a fifth of its deviation."""
    spread, restless = (np.trace(covariance[a::2, a::2]) for a in (0, 1))
    _, eta = measure(system, mean)
    squared = system.reference_range**2 * np.sqrt(system.reference_snr / eta)  # product of the legs
    far, rate = np.array([noise(system, waveform, each) for each in eta]).T
    bend = (spread / 2) ** 2 / squared
    turn = spread * restless / squared + bend * (mean[1] ** 2 + mean[3] ** 2) / squared
    return bool((seen & ((bend > 0.04 * far) | (turn > 0.04 * rate))).any())


def relinearised(system, x, P, z, waveform, seen, estimate):
    """Regress the measurements over the estimate's spread, and update the prediction x, P again, until it rests."""
    for _ in range(1, system.iterations):
        mean, covariance = estimate
        root = 2.0 * np.linalg.cholesky(covariance).T
        points = np.concatenate([mean + root, mean - root])
        looks = [measure(system, point) for point in points]
        Z = np.array([h[seen].ravel() for h, _ in looks])
        errors = [np.concatenate([noise(system, waveform, each) for each in eta[seen]]) for _, eta in looks]
        h, cross = Z.mean(axis=0), (points - mean).T @ (Z - Z.mean(axis=0)) / 8
        H = np.linalg.solve(covariance, cross).T
        residual = np.diag((Z - h).T @ (Z - h) / 8 - H @ covariance @ H.T)
        y = z[seen].ravel() - h - H @ (x - mean)
        estimate = update(x, P, y, H, np.diag(residual + np.mean(errors, axis=0)))
        if np.abs((estimate[0] - mean) / np.sqrt(np.diag(estimate[1]))).max() < 0.1:
            break
    return estimate


def step(system, world, k, action, truth, belief):
    """From step k to k + 1; arrays of one environment. The world follows ``system.truth_model``."""
    real, (target, waveform) = system.truth_model, divmod(action, len(system.waveforms))
    mean, covariance, targets = belief.mean.copy(), belief.covariance.copy(), truth.targets.copy()
    for t in range(system.targets):
        mean[t], covariance[t] = predict(mean[t], covariance[t], *model(system, belief.q[t]))
        F, Q = model(real, truth.q[t])
        targets[t] = F @ targets[t] + np.linalg.cholesky(Q) @ world.process[k, t]
    dead = belief.dead if target == belief.pointed else system.dead_steps
    if dead > 0:
        return Step(mean, covariance, targets, target, dead - 1, 0)
    z, eta = measure(real, targets[target])
    seen = world.detection[k, :, target] < detection(real, eta)
    if not truth.visible[k, target] or not seen.any():
        return Step(mean, covariance, targets, target, 0, 0)
    z += np.sqrt([noise(real, waveform, each) for each in eta]) * world.error[k, :, target]
    x, P = mean[target], covariance[target]
    h, expected = measure(system, x)
    R = np.diag(np.concatenate([noise(system, waveform, each) for each in expected[seen]]))
    H = jacobian(system, x)[seen].reshape(-1, 4)
    estimate = update(x, P, (z - h)[seen].ravel(), H, R)
    if curved(system, x, P, waveform, seen):
        estimate = relinearised(system, x, P, z, waveform, seen, estimate)
    mean[target], covariance[target] = estimate
    return Step(mean, covariance, targets, target, 0, int(seen.sum()))
