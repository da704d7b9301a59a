"""Kernels of the closed loop of one illuminator and its receivers: move, set up, look, track.

Shapes: e environments, t targets, j receivers, a = 2 j measured quantities, (range, range-rate) receiver by
receiver, n = 4 states [x xdot y ydot]. ``accuracy`` (waveform, 2): variances of range and range-rate at unit SNR.
``visible`` (e, k, t): whether a target is visible in step k; after the last step none is.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import detection
from wavegym.sensors.geometry_kernels import range_and_rate
from wavegym.trackers.rank_one_kernels import correct_one, gain_one, shrink_one

PLACE = (0, 2)  # elements of [x xdot y ydot] on which a range depends
ALL = (0, 1, 2, 3)  # elements on which a range-rate depends


class Radar(NamedTuple):
    """Constants: sites (1 + j, 2), the illuminator first, and scalars; see ``SectorSetup``."""

    sites: NDArray[np.float64]
    strength: float  # eta Rt^2 Rr^2
    nearest: float
    log_false_alarm: float
    dt: float
    dead_steps: int


@inlined
def turn(pointed, dead, target, dead_steps):
    """(target set up, dead steps left, whether a pulse is sent) after a step with the action ``target``."""
    if target != pointed:
        dead = dead_steps
    return target, max(dead - 1, 0), dead == 0


@inlined
def is_visible(e, k, t, visible):
    """Whether target t is visible in step k."""
    return k < visible.shape[1] and visible[e, k, t]


@inlined
def coast_mean_one(i, x, tau, o, x_out):
    """x_out[o] = x[i] after tau seconds."""
    x_out[o, 0], x_out[o, 1] = x[i, 0] + tau * x[i, 1], x[i, 1]
    x_out[o, 2], x_out[o, 3] = x[i, 2] + tau * x[i, 3], x[i, 3]


@inlined
def coast_one(i, P, tau, q, o, P_out):
    """P_out[o] = F P[i] F' + Q over tau seconds of white acceleration of density q: 16 products instead of 128.

    The motion model is ``constant_velocity(tau, q)``; its F only adds tau times a velocity.
    """
    for b in range(4):
        P_out[o, 0, b], P_out[o, 1, b] = P[i, 0, b] + tau * P[i, 1, b], P[i, 1, b]
        P_out[o, 2, b], P_out[o, 3, b] = P[i, 2, b] + tau * P[i, 3, b], P[i, 3, b]
    for a in range(4):
        P_out[o, a, 0] += tau * P_out[o, a, 1]
        P_out[o, a, 2] += tau * P_out[o, a, 3]
    speed = q * tau
    cross = 0.5 * speed * tau
    for a in PLACE:
        P_out[o, a, a] += cross * tau * (2.0 / 3.0)
        P_out[o, a + 1, a] += cross
        P_out[o, a + 1, a + 1] += speed
    for a in range(4):
        for b in range(a):
            P_out[o, b, a] = P_out[o, a, b]


@inlined
def look_one(i, x, j, radar, h, H):
    """eta of x[i] at receiver j; rows 2 j and 2 j + 1 of h (a,), H (a, n): half the path, its rate, their gradients.

    A leg shorter than ``nearest`` counts as ``nearest`` in the SNR and in the turn rate of its direction.
    """
    for row in (2 * j, 2 * j + 1):
        h[row] = 0.0
        for b in range(4):
            H[row, b] = 0.0
    eta = radar.strength
    for s in (0, j + 1):
        sx, sy = radar.sites[s, 0], radar.sites[s, 1]
        r, v = range_and_rate(x[i, 0], x[i, 2], x[i, 1], x[i, 3], sx, sy)
        held = max(r, radar.nearest)
        ux, uy = (x[i, 0] - sx) / r, (x[i, 2] - sy) / r
        eta /= held * held
        h[2 * j] += 0.5 * r
        h[2 * j + 1] += 0.5 * v
        H[2 * j, 0] += 0.5 * ux
        H[2 * j, 2] += 0.5 * uy
        H[2 * j + 1, 0] += 0.5 * (x[i, 1] - v * ux) / held
        H[2 * j + 1, 1] += 0.5 * ux
        H[2 * j + 1, 2] += 0.5 * (x[i, 3] - v * uy) / held
        H[2 * j + 1, 3] += 0.5 * uy
    return eta


@inlined
def probability(eta, radar):
    """Pd = Pf^(1 / (1 + eta / 2)), eta = 2E/N0."""
    return detection(0.5 * eta, radar.log_false_alarm)


@inlined
def shrink_by(i, j, P, H, w, accuracy, eta, v, nn):
    """Update P[i] with a detection of waveform w at receiver j."""
    s = gain_one(i, P, H, 2 * j, v, nn, PLACE) + accuracy[w, 0] / eta
    shrink_one(i, P, v, s, nn)
    s = gain_one(i, P, H, 2 * j + 1, v, nn, ALL) + accuracy[w, 1] / eta
    shrink_one(i, P, v, s, nn)


@inlined
def absorb_by(i, j, P, H, y, w, accuracy, eta, d, v, nn):
    """As ``shrink_by``, and add the correction of the mean by the innovations y (a,) to d (n,)."""
    s = gain_one(i, P, H, 2 * j, v, nn, PLACE) + accuracy[w, 0] / eta
    correct_one(d, H, 2 * j, v, s, y[2 * j], nn)
    shrink_one(i, P, v, s, nn)
    s = gain_one(i, P, H, 2 * j + 1, v, nn, ALL) + accuracy[w, 1] / eta
    correct_one(d, H, 2 * j + 1, v, s, y[2 * j + 1], nn)
    shrink_one(i, P, v, s, nn)


@kernel
def move(e, k, q, truth, process, L, mean, P, radar, truth_out, x, P_out, nn):
    """One step of the targets of environment e and of the belief; process (e, k, t, n), L L' = Q at unit density."""
    for t in range(mean.shape[1]):
        coast_mean_one(t, truth[e], radar.dt, t, truth_out[e])
        root = np.sqrt(q[e, t])
        for a in range(len(nn)):
            for b in range(a + 1):
                truth_out[e, t, a] += root * L[a, b] * process[e, k, t, b]
        coast_mean_one(t, mean[e], radar.dt, t, x[e])
        coast_one(t, P[e], radar.dt, q[e, t], t, P_out[e])


@kernel
def receive(e, k, t, w, truth, uniform, error, accuracy, radar, x, P, work, nn):
    """Update x[e, t], P[e, t] with the detections of target t; return their number.

    SNR, Pd and errors follow from the truth; the tracker uses the predicted SNR.
    """
    h, H, z, G, y, d, v = work
    for a in range(len(nn)):
        d[a] = 0.0
    detected = 0
    for j in range(uniform.shape[2]):
        true = look_one(t, truth[e], j, radar, z, G)
        if uniform[e, k, j, t] >= probability(true, radar):
            continue
        detected += 1
        eta = look_one(t, x[e], j, radar, h, H)
        for a in range(2):
            y[2 * j + a] = z[2 * j + a] + np.sqrt(accuracy[w, a] / true) * error[e, k, j, t, a] - h[2 * j + a]
        absorb_by(t, j, P[e], H, y, w, accuracy, eta, d, v, nn)
    for a in range(len(nn)):
        x[e, t, a] += d[a]
    return detected


@kernel
def transition(
    step, mean, P, pointed, dead, q, visible, truth, target, waveform, process, uniform, error, L, accuracy, radar,
    x, P_out, pointed_out, dead_out, truth_out, detections, silent, nn
):  # fmt: skip
    """One step of every environment; detections (e,): their number, silent (e,): whether no pulse was sent."""
    rows, n = 2 * uniform.shape[2], len(nn)
    work = (
        np.empty(rows), np.empty((rows, n)), np.empty(rows), np.empty((rows, n)), np.empty(rows), np.empty(n),
        np.empty(n)
    )  # fmt: skip
    for e in range(len(step)):
        k, t = step[e], target[e]
        move(e, k, q, truth, process, L, mean, P, radar, truth_out, x, P_out, nn)
        pointed_out[e], dead_out[e], sent = turn(pointed[e], dead[e], t, radar.dead_steps)
        silent[e], detections[e] = not sent, 0
        if sent and is_visible(e, k, t, visible):
            detections[e] = receive(
                e, k, t, waveform[e], truth_out, uniform, error, accuracy, radar, x, P_out, work, nn
            )
