"""What a scheduler may expect of a band, given the probability that each channel is occupied.

Shapes: e environments, a candidates, c channels.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import detection_of, effective_snr, inverse_snr
from wavegym.systems.shared_spectrum.kernels import coasted, errors_of, noise_factors, updated


@inlined
def outcome_one(b, noise, x, p00, p01, p11, radar, band):
    """(Pd, P00, P01, P11 of a detection) of band b in noise[0] for a target predicted at range x."""
    gain, delay = noise_factors(b, 0, noise, band)
    eta = gain / inverse_snr(x, radar.reference, radar.nearest)
    r00, r01, r11 = errors_of(b, effective_snr(eta, 0, radar.law), delay, band)
    after = updated(p00, p01, p11, r00, r01, r11)
    return detection_of(eta, 0, radar.law), after[4], after[5], after[6]


@inlined
def expected_one(b, probability, level, x, p00, p01, p11, radar, band, noise):
    """Expected (P00, P01, P11) after band b: over the occupancies of its channels, and over the detection."""
    first, width = band.first[b], band.width[b]
    e00, e01, e11 = 0.0, 0.0, 0.0
    for case in range(1 << width):
        weight = 1.0
        for i in range(width):
            c = first + i
            on = (case >> i) & 1
            weight *= probability[c] if on else 1.0 - probability[c]
            noise[0, c] = level[c] if on else 1.0
        if weight > 0.0:
            pd, a00, a01, a11 = outcome_one(b, noise, x, p00, p01, p11, radar, band)
            e00 += weight * (pd * a00 + (1.0 - pd) * p00)
            e01 += weight * (pd * a01 + (1.0 - pd) * p01)
            e11 += weight * (pd * a11 + (1.0 - pd) * p11)
    return e00, e01, e11


@kernel
def expected(mean, covariance, probability, level, actions, radar, band, x, P):
    """x (e, a, 2), P (e, a, 2, 2): predicted mean and expected covariance after bands (e or 1, a)."""
    noise = np.ones((1, probability.shape[1]))
    for e in range(x.shape[0]):
        p00, p01, p11 = coasted(e, covariance, radar.dt, radar.q)
        for a in range(x.shape[1]):
            b = actions[e if actions.shape[0] > 1 else 0, a]
            x[e, a, 0], x[e, a, 1] = mean[e, 0] + radar.dt * mean[e, 1], mean[e, 1]
            c00, c01, c11 = expected_one(b, probability[e], level[e], x[e, a, 0], p00, p01, p11, radar, band, noise)
            P[e, a, 0, 0], P[e, a, 0, 1], P[e, a, 1, 0], P[e, a, 1, 1] = c00, c01, c01, c11


@kernel
def drawn(mean, covariance, noise, detected, actions, radar, band, x, P):
    """As ``expected`` in given noise (e, a, c), detected where the draw (e, a) is below Pd."""
    for e in range(x.shape[0]):
        p00, p01, p11 = coasted(e, covariance, radar.dt, radar.q)
        for a in range(x.shape[1]):
            b = actions[e if actions.shape[0] > 1 else 0, a]
            x[e, a, 0], x[e, a, 1] = mean[e, 0] + radar.dt * mean[e, 1], mean[e, 1]
            pd, c00, c01, c11 = outcome_one(b, noise[e, a : a + 1], x[e, a, 0], p00, p01, p11, radar, band)
            if not detected[e, a] < pd:
                c00, c01, c11 = p00, p01, p11
            P[e, a, 0, 0], P[e, a, 0, 1], P[e, a, 1, 0], P[e, a, 1, 1] = c00, c01, c01, c11
