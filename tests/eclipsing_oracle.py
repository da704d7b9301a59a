"""Oracle of eclipsing: the Fisher information of a gated pulse, from inner products of its samples in the open gate."""

from __future__ import annotations

import numpy as np

from wavegym.waveforms import PulseTrain, transmitted_interval

C = 299792458.0
X, W = np.polynomial.legendre.leggauss(40)
STENCIL = np.array([1.0, -9.0, 45.0]) / 60.0  # first derivative, sixth order: f(3h), f(2h), f(h) less f(-3h), ...


def open_windows(pulse, delay, interval, recovery, **definition):
    """The parts of a pulse, in its own time, that meet an open receiver: brute force over 200 intervals around."""
    first, last = transmitted_interval(pulse, **definition)
    if interval is None:
        return [(last + recovery - delay, np.inf)]
    fold = round(delay / interval)
    return [
        (last + recovery + m * interval - delay, first + (m + 1) * interval - delay)
        for m in range(fold - 100, fold + 100)
    ]


def nodes(pulse, windows, panels=40):
    """Quadrature nodes and weights over the windows' parts in which the pulse is smooth."""
    t, weights = [], []
    for low, high in windows:
        for begins, ends in pulse.pieces:
            a, b = max(low, begins), min(high, ends)
            if a < b:
                half = 0.5 * (b - a) / panels
                centres = a + half * (2 * np.arange(panels) + 1)
                t.append((centres[:, None] + half * X).ravel())
                weights.append(np.tile(half * W, panels))
    return (np.concatenate(t), np.concatenate(weights)) if t else (np.zeros(0), np.zeros(0))


def derivative(function, t, step):
    ahead = sum(c * (function(t + k * step) - function(t - k * step)) for c, k in zip(STENCIL, (3, 2, 1), strict=True))
    return ahead / step


def pulse_rate(pulse, t):
    """s'(t) without its carrier exp(j phi): a' + j a w; steps never cross a kink."""
    edges = np.unique(np.ravel(pulse.pieces))
    nearest = np.abs(t[:, None] - edges).min(axis=1)
    step = np.minimum(2e-3 * (edges[-1] - edges[0]), 0.3 * nearest)
    return derivative(pulse.envelope, t, step) + 1j * pulse.envelope(t) * derivative(pulse.phase, t, step)


def information(waveform, delay, interval=None, recovery=0.0, **definition):
    """(share, J): visible share and information of (delay, angular Doppler), (2, 2), at transmitted SNR 1."""
    train = waveform if isinstance(waveform, PulseTrain) else None
    pulse = train.pulse if train else waveform
    interval = train.interval if train else interval
    t, weights = nodes(pulse, open_windows(pulse, delay, interval, recovery, **definition))
    count = train.count if train else 1
    starts = (np.arange(count) - (count - 1) / 2) * (interval or 0.0)
    a = np.tile(pulse.envelope(t), count) / np.sqrt(count)
    by_delay = -np.tile(pulse_rate(pulse, t), count) / np.sqrt(count)
    by_doppler = 1j * (starts[:, None] + t).ravel() * a
    weights = np.tile(weights, count)
    inner = lambda u, v: (np.conj(u) * v * weights).sum()  # noqa: E731
    energy = inner(a, a).real
    columns = [u - a * inner(a, u) / energy for u in (by_delay, by_doppler)]
    return energy, np.array([[inner(u, v).real for v in columns] for u in columns])


def covariance(waveform, range_m, carrier, **gate):
    """Covariance of (range, range-rate) at transmitted SNR 1."""
    _, J = information(waveform, range_m / (C / 2), **gate)
    gamma = np.diag([C / 2, -C / (2 * carrier) / (2 * np.pi)])
    return gamma @ np.linalg.inv(J) @ gamma.T
