"""Plain matrix versions of the kernels, and worlds to compare them on."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from scipy.stats import gamma, norm, truncnorm

C = 299792458.0


def worlds(system, count, seed=0):
    """``count`` tapes of ``system`` as one batch."""
    rng = np.random.default_rng(seed)
    tapes = [system.draw_world(rng) for _ in range(count)]
    return type(tapes[0])(*(np.stack(arrays) for arrays in zip(*tapes, strict=True)))


def rows(batch, index):
    """The environments ``index`` (a slice or an array) of a NamedTuple of arrays."""
    return type(batch)(*(None if a is None else a[index] for a in batch))


def in_step(single, batch, steps, seed=5):
    """Play drawn actions in a single environment and in all of a batch, which must return the same in row 0.

    Yields k from 1 on, and both results.
    """
    single.action_space.seed(1)
    seen, _ = single.reset(seed=seed)
    shown, _ = batch.reset(seed=seed)
    np.testing.assert_array_equal(seen, shown[0])
    for k in range(1, steps + 1):
        action = single.action_space.sample()
        one, many = single.step(action), batch.step(np.stack([action] * batch.num_envs))
        np.testing.assert_array_equal(one[0], many[0][0])
        assert one[1:4] == (many[1][0], many[2][0], many[3][0])
        assert np.isfinite(one[0]).all()
        yield k, one, many


def random_covariance(rng, n, lead=()):
    """Positive definite matrices with standard deviations over two decades."""
    root = rng.standard_normal((*lead, n, 2 * n)) * 10 ** rng.uniform(-1, 1, (*lead, n, 1))
    return root @ np.swapaxes(root, -1, -2)


def predict(x, P, F, Q):
    return F @ x, F @ P @ F.T + Q


def update(x, P, y, H, R):
    """Joseph's form, which tolerates rounding of the gain."""
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    left = np.eye(len(P)) - K @ H
    return x + K @ y, left @ P @ left.T + K @ R @ K.T


def chirp_covariance(k, sweep, fc=10.4e9):
    """Unit SNR; duration s, sweep Hz with its sign: the formula of Kershaw and Evans."""
    g, wc = np.pi * sweep / (2 * k), 2 * np.pi * fc
    cross = -(C**2) * g * k**2 / wc
    return np.array([[C**2 * k**2 / 2, cross], [cross, (C / wc) ** 2 * (1 / (2 * k**2) + 2 * g**2 * k**2)]])


@cache  # futures of all actions meet the same ranges
def received_covariance(k, sweep, r, reference):
    """Covariance of a pulse of its own echo from range r (m), SNR 1 at the range ``reference``: R of Kershaw and Evans.

    The receiver is off for the interval with 99 % of a pulse's energy. So it sees a tail of the Gaussian echo. The
    share of the information is the variance in this tail, times its weight, divided by the variance of the whole pulse.
    """
    tail = np.sqrt(2) * (np.sqrt(2) * norm.ppf(0.995) / 2 - 2 * r / C / k)  # standard deviations of |s|^2
    share = norm.sf(tail) * truncnorm.var(tail, np.inf)
    return chirp_covariance(k, sweep) * (r / reference) ** 4 / share


def motion(n, dt, q):
    """F and Q of white noise on the n-th derivative, from the definition Q = int f f' q dt."""
    F = np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])[:n, :n]
    node, weight = np.polynomial.legendre.leggauss(5)
    f = [[t ** (n - 1 - i) / (1, 1, 2)[n - 1 - i] for i in range(n)] for t in dt * (node + 1) / 2]
    return F, q * dt / 2 * sum(w * np.outer(v, v) for v, w in zip(f, weight, strict=True))


def covariance_distance(P, expected):
    """Largest difference, in units of the expected standard deviations."""
    sigma = np.sqrt(np.diagonal(expected, axis1=-2, axis2=-1))
    return np.abs((P - expected) / (sigma[..., :, None] * sigma[..., None, :])).max()


def echo_threshold(false_alarm, pulses):
    """Threshold of the power of ``pulses`` outputs with noise of unit power."""
    return gamma.isf(false_alarm, pulses)


def simulated_echoes(name, pulses, snr, false_alarm, count, rng, searched=0):
    """Amplitudes pulse by pulse, complex noise, a threshold: (detected, realised mean 2E/N0), both (count,)."""
    alike = name in ("swerling0", "swerling1", "swerling3")
    rows = (count, 1 if alike else pulses)
    if name == "swerling0":
        power = np.ones(rows)
    elif name in ("swerling1", "swerling2"):
        power = np.abs(rng.standard_normal(rows) + 1j * rng.standard_normal(rows)) ** 2 / 2
    else:  # the strong scatterer and the small ones: the sum of two exponential powers
        power = (rng.standard_normal((4, *rows)) ** 2).sum(axis=0) / 4
    power = np.broadcast_to(0.5 * snr * power, (count, pulses))
    phase = np.exp(2j * np.pi * rng.random((count, pulses)))
    noise = (rng.standard_normal((count, pulses)) + 1j * rng.standard_normal((count, pulses))) / math.sqrt(2)
    output = (np.abs(np.sqrt(power) * phase + noise) ** 2).sum(axis=1)
    output += 0.5 * (rng.standard_normal((count, searched)) ** 2).sum(axis=1)
    return output > echo_threshold(false_alarm, pulses), 2.0 * power.mean(axis=1)
