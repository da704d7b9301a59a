"""Kernels that predict the effect of looks.

Shapes and arguments are those of ``kernels.py``. There are c candidates; ``target`` and ``waveform`` of each candidate
are (c,) or (e, c).
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wavegym.core.array_kernels import copy_matrix
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import detection_of, effective_snr
from wavegym.systems.sector_setup.kernels import (
    ALL,
    PLACE,
    coast_mean_one,
    coast_one,
    decouple,
    heard_one,
    is_visible,
    look_one,
    turn,
)
from wavegym.systems.sector_setup.visibility_kernels import (
    chance_one,
    condition_covariance,
    condition_one,
    condition_worth,
    drawn_place,
    of_a_miss,
    sight_one,
    visibility_is_predicted,
)
from wavegym.trackers.kernels import correct_one, gain_one, shrink_one, spread_one

FAINT = 1e-6  # least observed standard deviation: keeps log10 finite


class Looks(NamedTuple):
    """A look at a target with one waveform, at all receivers."""

    geometric: NDArray[np.float64]  # (j,) eta of ``look_one``
    eta: NDArray[np.float64]  # (j,) effective eta of the train
    pd: NDArray[np.float64]  # (j,)
    mean_rate: NDArray[np.float64]  # (j,) variance of the mean range-rate
    h: NDArray[np.float64]  # (a,) predicted measurements
    H: NDArray[np.float64]  # (a + 1, n) their Jacobian, and a decoupled row
    V: NDArray[np.float64]  # (1, n, n)
    v: NDArray[np.float64]  # (n,)


@inlined
def workspace(receivers, n):
    """New ``Looks`` for this number of receivers and n states."""
    rows = 2 * receivers
    return Looks(
        np.empty(receivers), np.empty(receivers), np.empty(receivers), np.empty(receivers), np.empty(rows),
        np.empty((rows + 1, n)), np.empty((1, n, n)), np.empty(n)
    )  # fmt: skip


@inlined
def none_detects(pd):
    """Probability that no receiver detects a visible target."""
    missed = 1.0
    for j in range(len(pd)):
        missed *= 1.0 - pd[j]
    return missed


@inlined
def look_all(i, x, radar, work):
    """Write predicted measurements, Jacobians and eta of x[i] at all receivers to ``work``: the same for all trains."""
    for j in range(len(work.pd)):
        work.geometric[j] = look_one(i, x, j, radar, work.h, work.H)


@inlined
def hear_all(w, q, radar, work):
    """Write what is left of a look at a target of density q, with train w: its effective eta, Pd and mean rate."""
    for j in range(len(work.pd)):
        eta, work.mean_rate[j] = heard_one(work.geometric[j], j, w, q, work.H, radar)
        work.pd[j] = detection_of(eta, 0, radar.law)
        work.eta[j] = effective_snr(eta, 0, radar.law)


@inlined
def absorb_one(i, j, a, P, w, radar, work, nn):
    """(row of H, innovation variance) of quantity a of receiver j with train w; fills ``work.v``, the gain times it."""
    if a == 0:
        return 2 * j, gain_one(i, P, work.H, 2 * j, work.v, nn, PLACE) + radar.accuracy[w, 0] / work.eta[j]
    row = len(work.H) - 1
    decouple(j, w, work.H, radar, row)
    s = gain_one(i, P, work.H, row, work.v, nn, ALL)
    return row, s + radar.accuracy[w, 1] / work.eta[j] + work.mean_rate[j]


@inlined
def shrink_by(i, j, P, w, radar, work, nn):
    """Update P[i] with a detection of train w at receiver j."""
    for a in range(2):
        _, s = absorb_one(i, j, a, P, w, radar, work, nn)
        shrink_one(i, P, work.v, s, nn)


@kernel
def expect(i, P, w, radar, clear, P_missed, work, o, P_out, nn):
    """Fill P_out[o] with the mean of P[i] over all combinations of receivers that detect waveform w.

    P_missed[i]: the covariance if no receiver detects it. ``clear``: probability that the target is visible.
    """
    pd, V = work.pd, work.V
    P_out[o] = 0.0
    for combination in range(1 << len(pd)):
        copy_matrix(P[i] if combination else P_missed[i], V[0])
        chance = clear
        for j in range(len(pd)):
            if combination >> j & 1:
                chance *= pd[j]
                shrink_by(0, j, V, w, radar, work, nn)
            else:
                chance *= 1.0 - pd[j]
        if combination == 0:
            chance += 1.0 - clear
        for a in range(len(nn)):
            for b in range(len(nn)):
                P_out[o, a, b] += chance * V[0, a, b]


@inlined
def absorb_place(i, x, P, detected, w, radar, work, d, truth, nn):
    """Update x[i], P[i] with waveform w at the receivers whose bit is set, as if x + ``truth`` were measured exactly.

    This is the mean over measurement errors: the estimate moves towards the target. d (n,) is scratch space.
    """
    for a in range(len(nn)):
        d[a] = 0.0
    for j in range(len(work.pd)):
        for a in range(2 if detected >> j & 1 else 0):
            row, s = absorb_one(i, j, a, P, w, radar, work, nn)
            y = 0.0
            for b in range(len(nn)):
                y += work.H[row, b] * truth[b]
            correct_one(d, work.H, row, work.v, s, y, nn)
            shrink_one(i, P, work.v, s, nn)
    for a in range(len(nn)):
        x[i, a] += d[a]


@kernel
def draw_one(i, x, P, w, draws, last, radar, work, d, sight, truth, nn):
    """Update x[i], P[i] with a look whose outcome uniform draws decide: a receiver detects if its draw is below Pd.

    If visibility is predicted, the first draw picks a place of the target. Receivers can detect it only if this place
    is visible. A look that finds nothing changes the estimate as in the tracker. Returns 1 if the look finds the
    target, -1 if it finds nothing.
    """
    first, detected = len(draws) - len(work.pd), 0
    if first == 0 or drawn_place(i, x, P, draws[0], last, radar, truth, nn):
        for j in range(len(work.pd)):
            detected += (draws[first + j] < work.pd[j]) << j
    if first == 0:
        for j in range(len(work.pd)):
            if detected >> j & 1:
                shrink_by(i, j, P, w, radar, work, nn)
    elif detected:
        absorb_place(i, x, P, detected, w, radar, work, d, truth, nn)
    else:
        sight_one(i, x, P, last, radar, sight)
        condition_one(i, x, P, sight, 1.0, of_a_miss(none_detects(work.pd)), nn)
    return 1 if detected else -1


@kernel
def predict(
    step, mean, P, pointed, dead, q, visible, looked, target, waveform, draws, radar, x_out, P_out, pointed_out,
    dead_out, looked_out, nn
):  # fmt: skip
    """One step ahead for every candidate: x_out (e, c, t, n), P_out (e, c, t, n, n); pointed_out ... looked_out (e, c).

    target, waveform (e or 1, c); draws (e, c or 1, j) uniform, or (e, c or 1, 1 + j) if visibility is predicted, or
    (e, c or 1, 0) for the expected outcome.
    """
    (count, candidates, targets, n), receivers = x_out.shape, len(radar.sites) - 1
    ahead, V, work = np.empty((targets, n)), np.empty((targets, n, n)), workspace(receivers, n)
    V_missed, d, sight, truth, clear = np.empty((targets, n, n)), np.empty(n), np.zeros(6), np.empty(n), 1.0
    for e in range(count):
        own = e if len(target) > 1 else 0
        for t in range(targets):
            coast_mean_one(t, mean[e], radar.dt, radar.turn_rate, t, ahead)
            coast_one(t, P[e], radar.dt, radar.turn_rate, q[e, t], t, V)
        before = -1
        for c in range(candidates):
            t, w = target[own, c], waveform[own, c]
            pointed_out[e, c], dead_out[e, c], sent = turn(pointed[e], dead[e], t, radar.dead_steps)
            looked_out[e, c], last = 0, looked[e] if pointed[e] == t else 0
            for i in range(targets):
                copy_matrix(V[i], P_out[e, c, i])
                for a in range(n):
                    x_out[e, c, i, a] = ahead[i, a]
            if not (sent and is_visible(e, step[e], t, visible)):
                looked_out[e, c] = -1 if sent else 0
                continue
            given = draws[e, c if draws.shape[1] > 1 else 0]
            if t != before:
                look_all(t, ahead, radar, work)
            hear_all(w, q[e, t], radar, work)
            if len(given) == 0:
                copy_matrix(V[t], V_missed[t])
                if visibility_is_predicted(radar):
                    if t != before:
                        clear = sight_one(t, ahead, V, last, radar, sight)
                    condition_covariance(t, V_missed, sight, 1.0, of_a_miss(none_detects(work.pd)), nn)
                expect(t, V, w, radar, clear, V_missed, work, t, P_out[e, c], nn)
                looked_out[e, c] = -1 if clear * (1.0 - none_detects(work.pd)) < 0.5 else 1
            else:
                looked_out[e, c] = draw_one(
                    t, x_out[e, c], P_out[e, c], w, given, last, radar, work, d, sight, truth, nn
                )  # fmt: skip
            before = t


@inlined
def project_one(P, M, H, U, G, B, nn, mm):
    """Fill U (a, n) = H P, and the lower triangles of G (a, a) = H P H' and B = U M U'; P (1, n, n).

    All waveforms share these matrices. In measurement space a look is fast to evaluate: it lowers trace(M P) by
    trace((G + R)^-1 B).
    """
    for a in range(len(mm)):
        for i in range(len(nn)):
            U[a, i] = 0.0
        for k in range(len(nn)):
            for i in range(len(nn)):
                U[a, i] += H[a, k] * P[0, k, i]
    for a in range(len(mm)):
        for b in range(a + 1):
            G[a, b], B[a, b] = 0.0, 0.0
            for i in range(len(nn)):
                G[a, b] += U[a, i] * H[b, i]
        for i in range(len(nn)):
            weighted = 0.0
            for k in range(len(nn)):
                weighted += U[a, k] * M[k, i]
            for b in range(a + 1):
                B[a, b] += weighted * U[b, i]


@inlined
def worth_one(detected, G, B, w, radar, work, S, D, mm):
    """trace((G + R)^-1 B) over the rows of the receivers whose bit in ``detected`` is set, one quantity at a time.

    The rows are range and range-rate, so that G and B serve all trains; the errors of both are correlated.
    """
    total = 0.0
    for a in range(len(mm)):
        for b in range(a + 1):
            S[a, b], D[a, b] = G[a, b], B[a, b]
    for j in range(len(work.pd)):
        far, c = radar.accuracy[w, 0] / work.eta[j], radar.coupling[w]
        S[2 * j, 2 * j] += far
        S[2 * j + 1, 2 * j] += c * far
        S[2 * j + 1, 2 * j + 1] += c * c * far + radar.accuracy[w, 1] / work.eta[j] + work.mean_rate[j]
    for a in range(len(mm)):
        if detected >> (a // 2) & 1:
            inverse = 1.0 / S[a, a]
            total += D[a, a] * inverse
            for b in range(a + 1, len(mm)):
                g = S[b, a] * inverse
                for c in range(a + 1, b + 1):
                    f = S[c, a] * inverse
                    D[b, c] += g * (f * D[a, a] - D[c, a]) - f * D[b, a]
                    S[b, c] -= g * S[c, a]
    return total


@inlined
def expected_worth(G, B, w, radar, work, S, D, mm):
    """Mean of ``worth_one`` over all combinations of receivers that detect waveform w."""
    total, pd = 0.0, work.pd
    for combination in range(1, 1 << len(pd)):
        chance = 1.0
        for j in range(len(pd)):
            chance *= pd[j] if combination >> j & 1 else 1.0 - pd[j]
        total += chance * worth_one(combination, G, B, w, radar, work, S, D, mm)
    return total


@kernel
def gain(step, mean, P, pointed, q, visible, looked, target, waveform, wait, M, radar, out, nn, mm):
    """Fill out (e, c): trace(M[l - 1] (P_without - P_with)) of the candidate's target, for a look after ``wait`` steps.

    target, waveform (c,), where candidates of the same target are adjacent; wait (e or 1, c or 1); l: number of steps
    counted, at most len(M) and not beyond the horizon.
    """
    n, receivers, horizon = len(nn), len(radar.sites) - 1, visible.shape[1]
    ahead, V, work = np.empty((1, n)), np.empty((1, n, n)), workspace(receivers, n)
    U, G, B = np.empty((len(mm), n)), np.empty((len(mm), len(mm))), np.empty((len(mm), len(mm)))
    S, D = np.empty((len(mm), len(mm))), np.empty((len(mm), len(mm)))
    sight, clear = np.zeros(6), 1.0
    for e in range(len(step)):
        own = e if len(wait) > 1 else 0
        last, late = -1, -1
        for c in range(len(target)):
            t, delay = target[c], wait[own, c if wait.shape[1] > 1 else 0]
            k = step[e] + delay
            out[e, c] = 0.0
            if not is_visible(e, k, t, visible):
                continue
            if t != last or delay != late:
                turns = radar.turn_rate != 0.0  # then several steps are not one long step: Q is that of straight motion
                tau = radar.dt if turns else (delay + 1) * radar.dt
                coast_mean_one(t, mean[e], tau, radar.turn_rate, 0, ahead)
                coast_one(t, P[e], tau, radar.turn_rate, q[e, t], 0, V)
                for _ in range(delay if turns else 0):
                    coast_mean_one(0, ahead, tau, radar.turn_rate, 0, ahead)
                    coast_one(0, V, tau, radar.turn_rate, q[e, t], 0, V)
                look_all(0, ahead, radar, work)
                weights = M[min(len(M), horizon - k) - 1]
                project_one(V, weights, work.H, U, G, B, nn, mm)
                last, late = t, delay
                if visibility_is_predicted(radar):
                    recent = looked[e] if pointed[e] == t and delay == 0 else 0
                    clear = sight_one(0, ahead, V, recent, radar, sight)
            if clear > 0.0:
                w = waveform[c]
                hear_all(w, q[e, t], radar, work)
                out[e, c] = clear * expected_worth(G, B, w, radar, work, S, D, mm)
                if visibility_is_predicted(radar):
                    found = 1.0 - none_detects(work.pd)
                    out[e, c] += (1.0 - clear * found) * condition_worth(
                        0, V, sight, 1.0, of_a_miss(1.0 - found), weights, nn
                    )


@inlined
def predict_visibility_one(e, k, t, ahead, V, q, visible, last, radar, shown, x, P, nn):
    """Fill shown (s,): probability that target t is visible in steps k, k + 1, ...; ahead[0], V[0]: after step k.

    x (1, n) and P (1, n, n) are scratch space.
    """
    for s in range(len(shown)):
        shown[s] = is_visible(e, k + s, t, visible)
    if not visibility_is_predicted(radar):
        return
    for s in range(len(shown)):
        if s == 0:
            shown[0] *= chance_one(0, ahead, V, last, radar, radar.places)
            coast_mean_one(0, ahead, radar.dt, radar.turn_rate, 0, x)
            coast_one(0, V, radar.dt, radar.turn_rate, q, 0, P)
        elif shown[s] > 0.0:
            shown[s] *= chance_one(0, x, P, 0, radar, radar.few)
            coast_mean_one(0, x, radar.dt, radar.turn_rate, 0, x)
            coast_one(0, P, radar.dt, radar.turn_rate, q, 0, P)


@kernel
def predict_visibility(step, mean, P, pointed, dead, q, visible, looked, radar, out, nn):
    """Fill out (e, s, t): the probability that each target is visible in the next steps; 0 after the last step."""
    ahead, V = np.empty((1, len(nn))), np.empty((1, len(nn), len(nn)))
    x, P_later, shown = np.empty((1, len(nn))), np.empty((1, len(nn), len(nn))), np.empty(out.shape[1])
    for e in range(len(step)):
        for t in range(mean.shape[1]):
            coast_mean_one(t, mean[e], radar.dt, radar.turn_rate, 0, ahead)
            coast_one(t, P[e], radar.dt, radar.turn_rate, q[e, t], 0, V)
            last = looked[e] if pointed[e] == t else 0
            predict_visibility_one(e, step[e], t, ahead, V, q[e, t], visible, last, radar, shown, x, P_later, nn)
            for s in range(len(shown)):
                out[e, s, t] = shown[s]


@kernel
def observe(step, mean, P, pointed, dead, q, visible, looked, radar, soon, out, nn):
    """Fill out (e, field) in the order of ``SectorSetup.observation_fields``, with variances in place of deviations.

    Time left, dead steps left. For every target: whether set up, visible in this step, steps until that changes (up to
    ``soon``), fraction of the next ``soon`` steps in which it is visible, q, variances of position and velocity one
    step ahead. For every target and receiver: eta, and the variances of the predicted range and range-rate. If
    visibility is predicted, its probability replaces "visible"; it changes when the probability crosses 0.5.
    """
    n, receivers, horizon, shown = len(nn), len(radar.sites) - 1, visible.shape[1], np.empty(soon)
    ahead, V, work = np.empty((1, n)), np.empty((1, n, n)), workspace(receivers, n)
    later, P_later = np.empty((1, n)), np.empty((1, n, n))
    for e in range(len(step)):
        k = step[e]
        out[e, 0], out[e, 1] = (horizon - k) / horizon, dead[e]
        column = 2
        for t in range(mean.shape[1]):
            coast_mean_one(t, mean[e], radar.dt, radar.turn_rate, 0, ahead)
            coast_one(t, P[e], radar.dt, radar.turn_rate, q[e, t], 0, V)
            look_all(0, ahead, radar, work)
            last = looked[e] if pointed[e] == t else 0
            predict_visibility_one(e, k, t, ahead, V, q[e, t], visible, last, radar, shown, later, P_later, nn)
            now, change, share = shown[0], soon, 0.0
            for s in range(soon - 1, -1, -1):
                share += shown[s]
                if (shown[s] >= 0.5) != (now >= 0.5):
                    change = s
            out[e, column], out[e, column + 1] = pointed[e] == t, now
            out[e, column + 2], out[e, column + 3] = change, share / soon
            out[e, column + 4], out[e, column + 5] = q[e, t], V[0, 0, 0] + V[0, 2, 2]
            out[e, column + 6] = V[0, 1, 1] + V[0, 3, 3]
            column += 7
            for j in range(receivers):
                out[e, column] = work.geometric[j]
                out[e, column + 1] = max(spread_one(0, V, work.H, 2 * j, PLACE), FAINT * FAINT)
                out[e, column + 2] = max(spread_one(0, V, work.H, 2 * j + 1, ALL), FAINT * FAINT)
                column += 3
