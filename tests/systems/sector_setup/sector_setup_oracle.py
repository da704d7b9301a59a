"""One step of the sector-setup loop in plain NumPy: full matrices, Joseph's form, Jacobians by complex steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

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
    """F and Q of [x xdot y ydot]."""
    F, Q = motion(2, system.dt if seconds is None else seconds, q)
    return np.kron(np.eye(2), F), np.kron(np.eye(2), Q)


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


def step(system, world, k, action, mean, covariance, truth, pointed, dead, q, visible):
    """From step k to k + 1; arrays of one environment."""
    target, waveform = divmod(action, len(system.waveforms))
    mean, covariance, truth = mean.copy(), covariance.copy(), truth.copy()
    for t in range(system.targets):
        F, Q = model(system, q[t])
        mean[t], covariance[t] = predict(mean[t], covariance[t], F, Q)
        truth[t] = F @ truth[t] + np.linalg.cholesky(Q) @ world.process[k, t]
    if target != pointed:
        dead = system.dead_steps
    if dead > 0:
        return Step(mean, covariance, truth, target, dead - 1, 0)
    z, eta = measure(system, truth[target])
    seen = world.detection[k, :, target] < detection(system, eta)
    if not visible[k, target] or not seen.any():
        return Step(mean, covariance, truth, target, 0, 0)
    z += np.sqrt([noise(system, waveform, each) for each in eta]) * world.error[k, :, target]
    h, expected = measure(system, mean[target])
    R = np.diag(np.concatenate([noise(system, waveform, each) for each in expected[seen]]))
    H = jacobian(system, mean[target])[seen].reshape(-1, 4)
    mean[target], covariance[target] = update(mean[target], covariance[target], (z - h)[seen].ravel(), H, R)
    return Step(mean, covariance, truth, target, 0, int(seen.sum()))
