"""One step of the sector-setup loop in plain NumPy: full matrices, Joseph's form, Jacobians by complex steps.

Posterior linearisation as its paper has it (moments of the points, no shortcut for the residual), with the diagonal of
the residual's covariance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, expm
from scipy.special import erfinv

from tests.oracles import C as SPEED_OF_LIGHT
from tests.oracles import motion, predict, update
from wavegym.core import counter_rng_kernels
from wavegym.sensors import detection_probability, mean_inverse_detected_snr
from wavegym.sensors.trains import mean_rate_variance, motion_loss
from wavegym.waveforms import measurement_covariances


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


def look(system, x, waveform, q):
    """(mean eta of the train, C at unit SNR, variance of the mean range-rate) of a look at x; eta and variance (j,)."""
    count, interval, k, _ = system.waveforms[waveform]
    energy = count * k / max(n * duration for n, _, duration, _ in system.waveforms)
    seconds = (count - 1) * interval + 2 * k * erfinv(0.99)  # 99 % of the energy of the last pulse
    bisector = np.square(jacobian(system, x)[:, 0, [0, 2]]).sum(axis=-1)
    kept = motion_loss(seconds, SPEED_OF_LIGHT / system.carrier_hz, q * bisector)
    C = measurement_covariances(system.library, system.carrier_hz)[waveform]
    return measure(system, x)[1] * energy * kept, C, mean_rate_variance(seconds, q * bisector)


def detection(system, eta):
    return detection_probability(eta, system.false_alarm, system.fluctuation, searched=2)


def effective(system, eta):
    """eta at which C / eta is the mean covariance of a detected echo."""
    return 1 / mean_inverse_detected_snr(eta, system.false_alarm, system.fluctuation, searched=2, least=1.0)


def noise(system, x, waveform, q):
    """(R, Pd) of a look at x: mean covariances of detected echoes, (receiver, 2, 2), and (receiver,)."""
    eta, C, mean_rate = look(system, x, waveform, q)
    R = C / effective(system, eta)[:, None, None]
    R[:, 1, 1] += mean_rate
    return R, detection(system, eta)


def curved(system, mean, covariance, R, seen):
    """Whether a seen row's second-order terms over the prior's spread exceed a fifth of its deviation."""
    spread, restless = (np.trace(covariance[a::2, a::2]) for a in (0, 1))
    _, eta = measure(system, mean)
    squared = system.reference_range**2 * np.sqrt(system.reference_snr / eta)  # product of the legs
    slope = R[:, 0, 1] / R[:, 0, 0]
    bend = (spread / 2) ** 2 / squared
    turn = spread * restless / squared + bend * (mean[1] ** 2 + mean[3] ** 2) / squared + slope**2 * bend
    rest = R[:, 1, 1] - slope * R[:, 0, 1]
    return bool((seen & ((bend > 0.04 * R[:, 0, 0]) | (turn > 0.04 * rest))).any())


def relinearised(system, x, P, z, waveform, q, seen, estimate):
    """Regress the measurements over the estimate's spread, and update the prediction x, P again, until it rests.

    In the rows of range, and of range-rate minus its regression on the range, whose errors are independent.
    """
    for _ in range(1, system.iterations):
        mean, covariance = estimate
        _, C, mean_rate = look(system, mean, waveform, q)
        R, _ = noise(system, mean, waveform, q)
        slope = C[0, 1] / C[0, 0]
        apart = np.kron(np.eye(seen.sum()), [[1.0, 0.0], [-slope, 1.0]])
        rest = R[seen, 1, 1] - slope * R[seen, 0, 1] - mean_rate[seen]
        root = 2.0 * np.linalg.cholesky(covariance).T
        points = np.concatenate([mean + root, mean - root])
        looks = [measure(system, point) for point in points]
        Z = np.array([apart @ h[seen].ravel() for h, _ in looks])
        share = np.mean([measure(system, mean)[1][seen] / each[seen] for _, each in looks], axis=0)
        errors = np.stack([share * R[seen, 0, 0], share * rest + mean_rate[seen]], axis=1).ravel()
        h, cross = Z.mean(axis=0), (points - mean).T @ (Z - Z.mean(axis=0)) / 8
        H = np.linalg.solve(covariance, cross).T
        residual = np.diag((Z - h).T @ (Z - h) / 8 - H @ covariance @ H.T)
        y = apart @ z[seen].ravel() - h - H @ (x - mean)
        estimate = update(x, P, y, H, np.diag(residual + errors))
        if np.abs((estimate[0] - mean) / np.sqrt(np.diag(estimate[1]))).max() < 0.1:
            break
    return estimate


def received(system, eta, world, k, target, receiver):
    """SNR of the errors of one look, 0 without a detection: the receiver's output, |sqrt(S) + noise|^2 and peaks."""
    key = world.key
    for number in (k, target * len(system.receivers) + receiver):
        key = np.uint64(counter_rng_kernels.stream(key, number))

    def exponential(i):
        return -np.log(counter_rng_kernels.uniform(key, i))

    energy = (
        {
            "swerling0": lambda: 1.0,
            "swerling1": lambda: exponential(0),
            "swerling3": lambda: (exponential(0) + exponential(1)) / 2,
        }[system.fluctuation]()
        * eta
        / 2
    )
    noise = np.sqrt(exponential(2)) * np.exp(2j * np.pi * counter_rng_kernels.uniform(key, 3))
    output = abs(np.sqrt(energy) + noise) ** 2 + exponential(5)
    return max(2 * energy, 1.0) if output > -np.log(system.false_alarm) else 0.0


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
    z, _ = measure(real, targets[target])
    eta, C, mean_rate = look(real, targets[target], waveform, truth.q[target])
    snr = np.array([received(real, each, world, k, target, j) for j, each in enumerate(eta)])
    seen = snr > 0
    if not truth.visible[k, target] or not seen.any():
        return Step(mean, covariance, targets, target, 0, 0)
    for j in np.flatnonzero(seen):
        spread = C / snr[j] + np.diag([0.0, mean_rate[j]])
        z[j] += np.linalg.cholesky(spread) @ world.error[k, j, target]
    x, P = mean[target], covariance[target]
    h, _ = measure(system, x)
    R, _ = noise(system, x, waveform, belief.q[target])
    H = jacobian(system, x)[seen].reshape(-1, 4)
    estimate = update(x, P, (z - h)[seen].ravel(), H, block_diag(*R[seen]))
    if curved(system, x, P, R, seen):
        estimate = relinearised(system, x, P, z, waveform, belief.q[target], seen, estimate)
    mean[target], covariance[target] = estimate
    return Step(mean, covariance, targets, target, 0, int(seen.sum()))
