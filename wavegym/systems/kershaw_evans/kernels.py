"""The compiled Kershaw-Evans loop: one pass over the batch for each function of the system.

Shapes: e environments, c candidates, H steps, n states (r, rdot[, rddot]), m = 2 measurements (r, rdot). C is the
measurement covariance of the visible part of the pulse, at unit SNR; R = C / eta. M (1, 2, n) is the measurement matrix
[I 0]. F and Q are (1, n, n). Functions that predict also accept (e, n, n), for a tracker whose process noise differs
between environments. ``visible_information`` of ``actions.py`` has the derivation of eclipsing.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite.binding import add_symbol
from numba import types
from numba.extending import get_cython_function_address

from wavegym.core.array_kernels import copy_matrix
from wavegym.core.kernels import batched, inlined, kernel
from wavegym.sensors.detection_kernels import inverse_snr
from wavegym.trackers.kernels import (
    factor_innovation_one,
    predict_covariance_one,
    predict_mean_one,
    update_covariance_one,
    update_mean_one,
)
from wavegym.waveforms.fisher import SPEED_OF_LIGHT

LEAST_VISIBLE = 1e-9
"""A pulse that is wholly eclipsed keeps this share of its information: its errors are 3e4 times as large."""
WHOLE = -9.0
"""Deviations of the pulse's energy from its middle to the gate's begin, below which h is 1 in double precision."""


def _of_one_number(name: str) -> Any:
    """SciPy's function of this name from float64 to float64, for calls from kernels: the results have the same bits.

    SciPy gives the addresses of its compiled functions (``scipy.special.cython_special``). An address changes from
    process to process. So the machine code that Numba caches refers to a name, which receives the address here.
    """
    symbol = f"wavegym_{name}"
    add_symbol(symbol, get_cython_function_address("scipy.special.cython_special", f"__pyx_fuse_1{name}"))
    return types.ExternalFunction(symbol, types.float64(types.float64))


erfc = _of_one_number("erfc")
"""1 - erf(x)."""
erfcx = _of_one_number("erfcx")
"""exp(x^2) erfc(x)."""


@inlined
def visible_share(duration, range_m, half_length):
    """h(a), at least LEAST_VISIBLE; half_length: half of the transmitted interval, in durations; -inf: never cut."""
    a = np.sqrt(2.0) * (half_length - (2.0 / SPEED_OF_LIGHT) * abs(range_m) / duration)
    if a < WHOLE:
        return 1.0
    tail = np.sqrt(0.5) * a
    m = np.sqrt(2.0 / np.pi) / erfcx(tail)
    return max(0.5 * erfc(tail) * (1.0 + m * (a - m)), LEAST_VISIBLE)


@batched("(),(),()->()")
def visible_shares(duration, range_m, half_length, share):
    """``visible_share``, element by element."""
    for e in range(len(share)):
        share[e] = visible_share(duration[e], range_m[e], half_length[e])


@inlined
def received_one(C, duration, w, range_m, half_length, e, out):
    """out[e] (2, 2): C[w] of pulse w as received from range ``range_m``."""
    share = visible_share(duration[w], range_m, half_length)
    for i in range(2):
        for j in range(2):
            out[e, i, j] = C[w, i, j] / share


@kernel
def received(C, duration, which, range_m, half_length, out):
    """out (e, c, 2, 2): C (w, 2, 2) of pulses ``which`` (e or 1, c) as received from ranges (e,)."""
    for e in range(out.shape[0]):
        own, out_own = which[e if which.shape[0] > 1 else 0], out[e]
        for c in range(out.shape[1]):
            received_one(C, duration, own[c], range_m[e], half_length, c, out_own)


@inlined
def receive_one(e, k, truth, normal, C, scale, z):
    """z[e] (2,): range and range-rate of truth[e] with errors of covariance C[e] times ``scale``.

    The errors are the Cholesky factor of the covariance times the last two draws of normal[e, k].
    """
    last = normal.shape[2] - 1
    first = np.sqrt(C[e, 0, 0] * scale)
    cross = C[e, 1, 0] * scale / first
    rest = np.sqrt(C[e, 1, 1] * scale - cross * cross)
    z[e, 0] = truth[e, 0] + first * normal[e, k, last - 1]
    z[e, 1] = truth[e, 1] + cross * normal[e, k, last - 1] + rest * normal[e, k, last]


@inlined
def track_one(e, mean, P, z, R, scale, F, Q, M, T, y, L, D, V, w, x, P_out, nn, mm):
    """x[e], P_out[e]: predict mean[e], P[e] and update with z[e] of covariance R[e] times ``scale``."""
    predict_mean_one(e, mean, F, 0, x, nn)
    predict_covariance_one(e, P, F, Q, 0, T, P_out, nn)
    for i in range(2):
        y[e, i] = z[e, i] - x[e, i]
    factor_innovation_one(e, P_out, M, 0, R, e, scale, L, D, V, nn, mm)
    update_mean_one(e, x, y, L, D, V, w, x, nn, mm)
    update_covariance_one(e, P_out, D, V, e, P_out, nn, mm)


@kernel
def transition(
    mean, P, step, path, normal, C, duration, which, half, true_law, F, Q, M, r0, nearest, nn, mm, x, P_out, truth,
    step_out
):  # fmt: skip
    """Move, sense at the true range, track: fills the new x (e, n), P_out (e, n, n), truth (e, n) and step_out (e,).

    C, duration, which (e,), half: the ``Pulses`` that are sent. ``true_law``: reference and nearest range of the
    world's SNR law. The tracker assumes r0 and nearest. An episode that is over stays at the end of the path.
    """
    count, n, last = mean.shape[0], len(nn), path.shape[1] - 1
    y, z, received = np.empty((count, 2)), np.empty((count, 2)), np.empty((count, 2, 2))
    T, L, D, V, w = np.empty((n, n)), np.empty((2, 2)), np.empty(2), np.empty((n, 2)), np.empty(2)
    for e in range(count):
        step_out[e] = step[e] + 1
        k = min(step_out[e], last)
        for i in range(n):
            truth[e, i] = path[e, k, i]
        received_one(C, duration, which[e], truth[e, 0], half, e, received)
        receive_one(e, k, truth, normal, received, inverse_snr(truth[e, 0], true_law[0], true_law[1]), z)
        scale = inverse_snr(truth[e, 0], r0, nearest)
        track_one(e, mean, P, z, received, scale, F, Q, M, T, y, L, D, V, w, x, P_out, nn, mm)


@kernel
def receive(truth, step, normal, C, reference, nearest, z):
    """Fill z (e, 2) with the measurements of the step after ``step``; reference, nearest: the world's SNR law."""
    for e in range(len(step)):
        receive_one(e, step[e] + 1, truth, normal, C, inverse_snr(truth[e, 0], reference, nearest), z)


@kernel
def track(mean, P, z, R, F, Q, M, nn, mm, x, P_out):
    """Fill x (e, n), P_out (e, n, n): one step of the Kalman filter with measurements z (e, 2) of covariance R."""
    count, n = mean.shape[0], len(nn)
    y = np.empty((count, 2))
    T, L, D, V, w = np.empty((n, n)), np.empty((2, 2)), np.empty(2), np.empty((n, 2)), np.empty(2)
    for e in range(count):
        track_one(e, mean, P, z, R, 1.0, F, Q, M, T, y, L, D, V, w, x, P_out, nn, mm)


@kernel
def predict(mean, P, C, F, Q, M, r0, nearest, nn, mm):
    """Predicted mean (e, c, n), updated covariance (e, c, n, n) for C (e or 1, c, 2, 2); SNR at the predicted range."""
    count, candidates, n = mean.shape[0], C.shape[1], len(nn)
    x, out = np.empty((count, candidates, n)), np.empty((count, candidates, n, n))
    T, L, D, V = np.empty((n, n)), np.empty((2, 2)), np.empty(2), np.empty((n, 2))
    ahead, predicted = np.empty((count, n)), np.empty((count, n, n))
    for e in range(count):
        f = e if F.shape[0] > 1 else 0
        predict_mean_one(e, mean, F, f, ahead, nn)
        predict_covariance_one(e, P, F, Q, f, T, predicted, nn)
        scale = inverse_snr(ahead[e, 0], r0, nearest)
        C_own, out_own = C[e if C.shape[0] > 1 else 0], out[e]
        for c in range(candidates):
            factor_innovation_one(e, predicted, M, 0, C_own, c, scale, L, D, V, nn, mm)
            update_covariance_one(e, predicted, D, V, c, out_own, nn, mm)
            for i in range(n):
                x[e, c, i] = ahead[e, i]
    return x, out


@kernel
def observe(mean, P, step, horizon, r0, nearest, nn, out):
    """out (e, elements), in physical units: SNR dB, rdot, log10 of deviations, correlations, time left."""
    n = len(nn)
    for e in range(mean.shape[0]):
        out[e, 0] = -10.0 * np.log10(inverse_snr(mean[e, 0], r0, nearest))
        out[e, 1] = mean[e, 1]
        column = 2
        for i in range(n):
            out[e, column] = 0.5 * np.log10(P[e, i, i])
            column += 1
        for i in range(n):
            for j in range(i):
                out[e, column] = P[e, i, j] / np.sqrt(P[e, i, i] * P[e, j, j])
                column += 1
        out[e, column] = 1.0 - step[e] / horizon


@kernel
def track_errors(mean, P, truth, out):
    """out (4, e): |range error|, variance of range, |range-rate error|, NEES over both (2 degrees of freedom)."""
    for e in range(mean.shape[0]):
        a, b = mean[e, 0] - truth[e, 0], mean[e, 1] - truth[e, 1]
        determinant = P[e, 0, 0] * P[e, 1, 1] - P[e, 0, 1] * P[e, 1, 0]
        out[0, e], out[1, e], out[2, e] = abs(a), P[e, 0, 0], abs(b)
        out[3, e] = (a * a * P[e, 1, 1] - 2.0 * a * b * P[e, 0, 1] + b * b * P[e, 0, 0]) / determinant


@kernel
def ranges_ahead(mean, F, levels, nn):
    """Ranges predicted 1 ... ``levels`` steps ahead, (e, levels)."""
    out = np.empty((mean.shape[0], levels))
    ahead = np.empty((1, len(nn)))
    for e in range(mean.shape[0]):
        f = e if F.shape[0] > 1 else 0
        now = mean[e : e + 1].copy()
        for level in range(levels):
            predict_mean_one(0, now, F, f, ahead, nn)
            now, ahead = ahead, now
            out[e, level] = now[0, 0]
    return out


@kernel
def lookahead(mean, P, C, r, step, horizon, weights, F, Q, M, r0, nearest, nn, mm):
    """First action of the best sequence of as many steps as r has (fewer at the episode's end), and its cost.

    Depth first, so the memory is one covariance for each level. A branch ends when its cost reaches the best total,
    because costs are not negative. r (e, levels): predicted ranges, which set the SNR; C (e or 1, levels or 1, c, 2,
    2): the covariances there.
    """
    count, n, depth, candidates = mean.shape[0], len(nn), r.shape[1], C.shape[2]
    best, first = np.full(count, np.inf), np.zeros(count, np.int64)
    T, L, D, V = np.empty((n, n)), np.empty((2, 2)), np.empty(2), np.empty((n, 2))
    updated, predicted = np.empty((depth + 1, n, n)), np.empty((depth, n, n))
    spent, tried = np.zeros(depth + 1), np.empty(depth, np.int64)
    for e in range(count):
        levels = max(1, min(depth, horizon - step[e]))  # an episode that is over gets an action that nobody uses
        f = e if F.shape[0] > 1 else 0
        C_own = C[e if C.shape[0] > 1 else 0]
        copy_matrix(P[e], updated[0])
        level = 0
        tried[0] = -1
        while level >= 0:
            if tried[level] < 0:
                predict_covariance_one(level, updated, F, Q, f, T, predicted, nn)
            tried[level] += 1
            if tried[level] == candidates:
                level -= 1
                continue
            scale, C_there = inverse_snr(r[e, level], r0, nearest), C_own[level if C.shape[1] > 1 else 0]
            factor_innovation_one(level, predicted, M, 0, C_there, tried[level], scale, L, D, V, nn, mm)
            update_covariance_one(level, predicted, D, V, level + 1, updated, nn, mm)
            total = spent[level]
            for i in range(n):
                total += weights[i] * updated[level + 1, i, i]
            if total < best[e] and level + 1 == levels:
                best[e], first[e] = total, tried[0]
            elif total < best[e]:
                level += 1
                spent[level] = total
                tried[level] = -1
    return first, best
