"""The compiled loop: users, target, train, receiver and Kalman filter of one step.

Shapes: e environments, c channels, b bands, h steps of history, S steps of listening before the first train.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import CELL, effective_snr, inverse_snr, received_snr
from wavegym.systems.shared_spectrum.user_kernels import NOISE, OFF, PLACE, WIDTH, advance_user, overlaps

CHOICES, ECHOES, OWN = range(3)  # keys of a world
BUSY = 10  # half decibels over the receiver's noise from which a channel counts as occupied
BUSY_NOISE = 10.0 ** (0.05 * BUSY)  # the same in units of that noise
RECENT = 0.2  # weight of the last step in the mean noise of an occupied channel


class Band(NamedTuple):
    """Bands and trains; (b, c) as in ``wavegym.sensors.interference``."""

    first: Any  # (b,)
    width: Any  # (b,)
    share: Any
    moment: Any
    square: Any
    range_variance: Any  # (b,) at unit SNR and known Doppler, m^2
    coupling: Any  # (b,) s: error of range per error of range-rate
    rate_variance: float  # at unit SNR, m^2/s^2
    whitening: bool  # the receiver


class Radar(NamedTuple):
    """Constants of the world, or those that the tracker assumes."""

    law: Any  # EchoLaw
    reference: float
    nearest: float
    dt: float
    q: float
    takeover: float
    spill: float  # share of a user's power in each channel beside its own
    sensing: float  # dB
    correction: float  # mean of the true over the measured noise, by which the tracker multiplies
    quiet: float  # measured noise up to which a channel counts as free


@inlined
def noise_factors(b, e, noise, band):
    """(factor on eta, factor on the variance of delay at that eta) of band b in noise[e]; see ``interference``."""
    W, square, moment = 0.0, 0.0, 0.0
    for c in range(band.first[b], band.first[b] + band.width[b]):
        n = 1.0 / noise[e, c] if band.whitening else noise[e, c]
        W += band.share[b, c] * n
        square += band.square[b, c] * n
        moment += band.moment[b, c] * n
    if band.whitening:
        return W, W / (square - 12.0 * moment * moment / W)
    return 1.0 / W, square / W


@inlined
def errors_of(b, eta, delay, band):
    """Covariance (range, cross, range-rate) of the errors of band b at this SNR."""
    rate = band.rate_variance / eta
    cross = band.coupling[b] * rate
    return band.range_variance[b] * delay / eta + band.coupling[b] * cross, cross, rate


@inlined
def coasted(e, P, dt, q):
    """(P00, P01, P11) of P[e] after a step of white acceleration."""
    p11 = P[e, 1, 1]
    p01 = P[e, 0, 1] + dt * p11
    p00 = P[e, 0, 0] + dt * (P[e, 0, 1] + p01)
    return p00 + q * dt * dt * dt / 3.0, p01 + 0.5 * q * dt * dt, p11 + q * dt


@inlined
def updated(p00, p01, p11, r00, r01, r11):
    """(gains k00, k01, k10, k11 and P00, P01, P11) of an update with errors of covariance r."""
    s00, s01, s11 = p00 + r00, p01 + r01, p11 + r11
    det = s00 * s11 - s01 * s01
    k00, k01 = (p00 * s11 - p01 * s01) / det, (p01 * s00 - p00 * s01) / det
    k10, k11 = (p01 * s11 - p11 * s01) / det, (p11 * s00 - p01 * s01) / det
    # (I - K) P (I - K)' + K R K', which stays symmetric and positive
    a00, a01, a10, a11 = 1.0 - k00, -k01, -k10, 1.0 - k11
    u00, u01 = a00 * p00 + a01 * p01, a00 * p01 + a01 * p11
    u10, u11 = a10 * p00 + a11 * p01, a10 * p01 + a11 * p11
    v00, v01 = k00 * r00 + k01 * r01, k00 * r01 + k01 * r11
    v10, v11 = k10 * r00 + k11 * r01, k10 * r01 + k11 * r11
    return (
        k00, k01, k10, k11,
        u00 * a00 + u01 * a01 + v00 * k00 + v01 * k01,
        u00 * a10 + u01 * a11 + v00 * k10 + v01 * k11,
        u10 * a10 + u11 * a11 + v10 * k10 + v11 * k11,
    )  # fmt: skip


@inlined
def users_one(e, k, key, users, now, taken, heard, radar, out, noise):
    """Users of world e one step on, and noise[e] (c,) in the train; k: steps from the first step of listening on."""
    channels = noise.shape[1]
    for c in range(channels):
        noise[e, c] = 1.0
    step = stream(key[e, CHOICES], k)
    for u in range(users.shape[1]):
        advance_user(e, u, users, now, taken, heard, stream(step, u), radar.takeover, out)
        first = out[e, u, PLACE]
        if first != OFF:
            above = first + int(users[e, u, WIDTH])
            for c in range(max(first - 1, 0), min(above + 1, channels)):
                own = first <= c < above
                noise[e, c] += users[e, u, NOISE] * (1.0 if own else radar.spill)


@inlined
def collide_one(e, b, users, places, band, taken):
    """Write the channels of band b to taken[e]; return the number of users there."""
    hit = 0
    taken[e, 0], taken[e, 1] = band.first[b], band.first[b] + band.width[b]
    for u in range(users.shape[1]):
        hit += overlaps(places[e, u, PLACE], int(users[e, u, WIDTH]), taken[e])
    return hit


@inlined
def receive_one(e, k, b, targets, noise, key, normal, sensing, listened, radar, band, z, measured):
    """Whether the target is detected; write z[e] (2,) and the measured noise[e] (c,)."""
    for c in range(noise.shape[1]):
        measured[e, c] = noise[e, c] * 10.0 ** (0.1 * radar.sensing * sensing[e, listened + k, c])
    gain, delay = noise_factors(b, e, noise, band)
    mean = gain / inverse_snr(targets[e, 0], radar.reference, radar.nearest)
    eta = received_snr(mean, 0, stream(key[e, ECHOES], k), radar.law)
    r00, r01, r11 = errors_of(b, max(eta, CELL), delay, band)
    one, first, second = np.sqrt(r00), normal[e, k + 1, 2], normal[e, k + 1, 3]
    z[e, 0] = targets[e, 0] + one * first
    z[e, 1] = targets[e, 1] + r01 / one * first + np.sqrt(r11 - r01 * r01 / r00) * second
    return eta > 0.0


@inlined
def filter_one(e, b, mean, covariance, present, z, measured, radar, band, assumed, mean_out, covariance_out):
    """A step of the Kalman filter; assumed[e] (c,): the noise that it takes from the measured one."""
    for c in range(measured.shape[1]):
        n = measured[e, c]
        assumed[e, c] = 1.0 if n < radar.quiet else n * radar.correction
    p00, p01, p11 = coasted(e, covariance, radar.dt, radar.q)
    m0, m1 = mean[e, 0] + radar.dt * mean[e, 1], mean[e, 1]
    gain, delay = noise_factors(b, e, assumed, band)
    eta = effective_snr(gain / inverse_snr(m0, radar.reference, radar.nearest), 0, radar.law)
    r00, r01, r11 = errors_of(b, eta, delay, band)
    if present:
        k00, k01, k10, k11, p00, p01, p11 = updated(p00, p01, p11, r00, r01, r11)
        y0, y1 = z[e, 0] - m0, z[e, 1] - m1
        m0, m1 = m0 + k00 * y0 + k01 * y1, m1 + k10 * y0 + k11 * y1
    mean_out[e, 0], mean_out[e, 1] = m0, m1
    covariance_out[e, 0, 0], covariance_out[e, 0, 1] = p00, p01
    covariance_out[e, 1, 0], covariance_out[e, 1, 1] = p01, p11


@inlined
def remember_one(e, k, row, b, noise, known, band, heard, sent, level):
    """Append known[e] (c,) and own band b to the history; return the occupied channels of the band by noise[e] (c,).

    b < 0: no train. heard[e, row] and sent[e, k] are written, but not past an episode's end, to which planners predict,
    and no row < 0, before anything was known.
    """
    struck, inside = 0.0, k < sent.shape[1]
    for c in range(noise.shape[1]):
        if b >= 0 and band.first[b] <= c < band.first[b] + band.width[b]:
            struck += is_busy(half_decibels(noise[e, c]))
        if inside and row >= 0:
            heard[e, row, c] = half_decibels(known[e, c])
            if is_busy(heard[e, row, c]):
                level[e, c] += RECENT * (10.0 ** (0.05 * heard[e, row, c]) - level[e, c])
    if inside and b >= 0:
        sent[e, k] = b
    return struck


@inlined
def half_decibels(noise):
    """The noise as it is kept in the history: half decibels, uint8."""
    return np.uint8(min(max(round(20.0 * np.log10(noise)), 0), 255))


@inlined
def is_busy(kept):
    """Whether a channel with this noise, in half decibels, counts as occupied."""
    return kept >= BUSY


@kernel
def users_step(first, key, users, now, taken, heard, radar, out, noise):
    """``users_one`` of each world; first (e,): steps from the first step of listening on."""
    for e in range(len(first)):
        users_one(e, first[e], key, users, now, taken, heard, radar, out, noise)


@kernel
def collide(action, users, places, band, taken, collisions):
    """``collide_one`` of each world."""
    for e in range(len(action)):
        collisions[e] = collide_one(e, action[e], users, places, band, taken)


@kernel
def own_draws(first, key, count, out):
    """Uniform draws (e, count) of a step for a user's own kinds of users."""
    for e in range(len(first)):
        step = stream(key[e, OWN], first[e])
        for i in range(count):
            out[e, i] = uniform(step, i)


@kernel
def receive(step, targets, noise, action, key, normal, sensing, listened, radar, band, present, z, measured):
    """``receive_one`` of each world; listened: steps of the tape before the first train."""
    for e in range(len(step)):
        present[e] = receive_one(
            e, step[e], action[e], targets, noise, key, normal, sensing, listened, radar, band, z, measured
        )


@kernel
def filtered(mean, covariance, present, z, noise, action, radar, band, mean_out, covariance_out):
    """``filter_one`` of each world."""
    assumed = np.empty_like(noise)
    for e in range(len(action)):
        filter_one(e, action[e], mean, covariance, present[e], z, noise, radar, band, assumed, mean_out, covariance_out)


@kernel
def remember(step, row, action, noise, known, band, heard, sent, level, struck):
    """``remember_one`` of each world, in place; step, row, action (e,)."""
    for e in range(len(noise)):
        struck[e] = remember_one(e, step[e], row[e], action[e], noise, known, band, heard, sent, level)


@kernel
def transition(
    step, action, path, users, now, taken, before, late, key, normal, sensing, listened, world_radar, mean, covariance,
    radar, band, targets, after, now_taken, noise, collisions, mean_out, covariance_out, heard, sent, level, struck,
):  # fmt: skip
    """One step of each world: users, target, train, filter and history.

    In place: late (e, delay, c), the measured noise that is not known yet; heard, sent, level: see ``Belief``.
    taken, before: the radar's band and the noise of the last step; now_taken, noise: those of this one.
    """
    z, measured, assumed, known = np.empty_like(mean), np.empty_like(noise), np.empty_like(noise), np.empty_like(noise)
    delay = late.shape[1]
    for e in range(len(step)):
        k, b = step[e], action[e]
        users_one(e, listened + k, key, users, now, taken, before, world_radar, after, noise)
        targets[e, 0], targets[e, 1] = path[e, k + 1, 0], path[e, k + 1, 1]
        present = receive_one(e, k, b, targets, noise, key, normal, sensing, listened, world_radar, band, z, measured)
        filter_one(e, b, mean, covariance, present, z, measured, radar, band, assumed, mean_out, covariance_out)
        known[e] = late[e, -1] if delay else measured[e]
        for d in range(delay - 1, -1, -1):
            late[e, d] = late[e, d - 1] if d else measured[e]
        struck[e] = remember_one(e, k, listened + k - delay, b, measured, known, band, heard, sent, level)
        collisions[e] = collide_one(e, b, users, after, band, now_taken)


@kernel
def figures(targets, mean, covariance, sent, step, collisions, width, out):
    """See ``SharedSpectrum.state_info``: out (6, e), in its order; width (b,) share of the spectrum."""
    for e in range(len(step)):
        x, v = mean[e, 0] - targets[e, 0], mean[e, 1] - targets[e, 1]
        xx, xv, vv = covariance[e, 0, 0], covariance[e, 0, 1], covariance[e, 1, 1]
        b = sent[e, step[e] - 1] if step[e] > 0 else -1
        out[0, e], out[1, e], out[2, e] = abs(x), abs(v), xx
        out[3, e] = (vv * x * x - 2.0 * xv * x * v + xx * v * v) / (xx * vv - xv * xv)
        out[4, e], out[5, e] = collisions[e], width[b] if b >= 0 else 0.0


@kernel
def observe(mean, covariance, step, heard, sent, history, delay, horizon, radar, band, out):
    """See ``SharedSpectrum.observation_fields``; delay: last steps whose noise is not known yet."""
    listened = heard.shape[1] - sent.shape[1]
    for e in range(len(step)):
        k, row = step[e], listened + step[e] - delay
        out[e, 0] = -10.0 * np.log10(inverse_snr(mean[e, 0], radar.reference, radar.nearest))
        out[e, 1] = 0.5 * np.log10(covariance[e, 0, 0])
        out[e, 2] = 0.5 * np.log10(covariance[e, 1, 1])
        out[e, 3] = 1.0 - k / horizon
        place, channels = 4, heard.shape[2]
        for h in range(1, history + 1):
            b = sent[e, k - h] if k >= h else -1
            for c in range(channels):
                out[e, place] = 0.5 * heard[e, row - h, c] if row >= h else 0.0
                held = b >= 0 and band.first[b] <= c < band.first[b] + band.width[b]
                out[e, place + channels * history] = 1.0 if held else 0.0
                place += 1
