"""The RF/EO loop in compiled form: move the targets, measure them, track them.

Shapes and arguments as in ``look_kernels.py``. The world and the tracker have numbers of their own: ``true_rules`` and
the field of view ``true_view`` are the world's. A view is the tuple of variance, low and high, (p, 3) each.

LANES environments go side by side (``core/lane_kernels.py``), one target after another. ``rows`` are Lanes: the numbers
of the environments. Where there are fewer than LANES, the last one repeats, and ``live`` lanes count. ``here`` tells in
which lanes the target is in the scene; k is the step, by lanes.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.core.lane_array_kernels import empty_lanes, gather_part, gathered, prefetch, scatter, scatter_part
from wavegym.core.lane_kernels import LANES, each_lane, rows_from, where
from wavegym.sensors.folding_kernels import apparent
from wavegym.sensors.platform_kernels import penalty_of, polar
from wavegym.systems.rf_eo.look_kernels import (
    hidden_half,
    information_one,
    is_here,
    look_one,
    spread_of,
    view_all,
    width_of,
)
from wavegym.systems.rf_eo.tracker_kernels import track_lanes, unfold_lanes
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one, squared_mahalanobis_one

ONE, THREE, FOUR = (0,), (0, 0, 0), (0, 0, 0, 0)
FAINT = 1e-6  # least observed value of a quantity or its standard deviation: keeps log10 finite
apparent_of = each_lane(apparent)


@inlined
def is_hidden(true, high, j, rules):
    """Whether platform j's radar misses a target: in a blind zone of its range, or in its clutter notch."""
    hidden = False
    for q in range(2):
        W = width_of(q, high[j, q], rules)
        hidden |= abs(true[q] - W * np.rint(true[q] / W)) < hidden_half(q, W, rules)
    return hidden


@inlined
def receive_one(i, truth, h, error, places, view, true_view, fence, rules, true_rules, z, R):
    """Measure truth[i]: fills z (a,) and the tracker's variances R (a,), 0 and infinite for quantities out of view.

    h (a,): predicted quantities; error (a,): standard normal. Returns the number of quantities received. With folding,
    range and range-rate fold, and the radar receives both or none.
    """
    received = 0.0
    variance, low, high = view
    true_variance, true_low, true_high = true_view
    for j in range(places.shape[0]):
        sx, sy = places[j, 0], places[j, 1]
        true = polar(truth[i, 0], truth[i, 1], truth[i, 2], truth[i, 3], sx, sy, places[j, 2], rules.printed)
        blind = (true[0] < true_rules.nearest) | (h[3 * j] < rules.nearest)
        hidden = blind | is_hidden(true, true_high, j, true_rules) if true_rules.folding else blind
        for q in range(3):
            a, lo, hi, drawn = 3 * j + q, true_low[j, q], true_high[j, q], true_variance[j, q]
            folds, missed, assumed = true_rules.folding and q < 2, blind, variance[j, q]
            if folds:
                missed = hidden
            elif rules.inflated:
                assumed += penalty_of(rules.penalty, h[a], low[j, q], high[j, q], fence[0, q], fence[1, q])
                drawn += penalty_of(rules.penalty, true[q], lo, hi, fence[0, q], fence[1, q])
            else:
                missed = blind | (true[q] < lo) | (true[q] > hi)
            value = true[q] + np.sqrt(drawn) * error[a]
            if folds:
                W = width_of(q, hi, true_rules)
                value = apparent_of(value, W, -0.5 * q * W)
            z[a], R[a] = where(missed, 0.0, value), where(missed, np.inf, assumed)
            received += where(missed, 0.0, 1.0)
    return received


@inlined
def move_one(i, truth, F, L, process, truth_out, nn):
    """Move a target: truth_out[i] = F truth[i] + L process[0], process (1, n)."""
    predict_mean_one(i, truth, F, 0, truth_out, nn)
    for a in range(len(nn)):
        for b in range(a + 1):
            truth_out[i, a] += L[a, b] * process[0, b]


@inlined
def load_settings(settings, rows, places, rules, work):
    """Fill the view and the aimed places of settings (e, p, 4)."""
    gather_part(settings, (rows,), work.settings[0])
    for j in range(work.settings.shape[1]):
        work.aimed[j, 0], work.aimed[j, 1], work.aimed[j, 2] = places[j, 0], places[j, 1], work.settings[0, j, 3]
    view_all(0, work.settings, rules, *work.own_view)


class Work(NamedTuple):
    """Scratch space: LANES environments with one target each."""

    before: Any  # (1, n) mean before the step
    P_before: Any  # (1, n, n)
    x: Any  # (1, n) predicted, then updated mean
    P: Any  # (1, n, n)
    h: Any  # (a,) predicted quantities, and so z, R and y
    H: Any  # (a, n) their gradients
    z: Any
    R: Any
    y: Any
    d: Any  # (n,)
    v: Any  # (n,)
    T: Any  # (n, n)
    aimed: Any  # (p, 3) places, where azimuths count from the look directions
    own_view: Any  # of the tracker
    settings: Any  # (1, p, 4)
    error: Any  # (p, 3) of the measurements


@inlined
def empty_view(pp):
    """Variance, low and high, to be filled by ``view_all``."""
    return empty_lanes((pp, THREE)), empty_lanes((pp, THREE)), empty_lanes((pp, THREE))


@inlined
def work_for(nn, pp):
    """Scratch space for n elements of the state and p platforms."""
    aa = pp + pp + pp
    return Work(
        empty_lanes((ONE, nn)), empty_lanes((ONE, nn, nn)), empty_lanes((ONE, nn)), empty_lanes((ONE, nn, nn)),
        empty_lanes((aa,)), empty_lanes((aa, nn)), empty_lanes((aa,)), empty_lanes((aa,)), empty_lanes((aa,)),
        empty_lanes((nn,)), empty_lanes((nn,)), empty_lanes((nn, nn)), empty_lanes((pp, THREE)), empty_view(pp),
        empty_lanes((ONE, pp, FOUR)), empty_lanes((pp, THREE)),
    )  # fmt: skip


@inlined
def predict_target(rows, t, mean, P, F, Q, rules, work, nn):
    """Load target t of the belief mean (e, t, n), P (e, t, n, n), and predict it and its measurements."""
    gather_part(mean, (rows, t), work.before[0])
    gather_part(P, (rows, t), work.P_before[0])
    for a in range(len(nn)):
        for b in range(a):
            work.P_before[0, b, a] = work.P_before[0, a, b]  # the half that counts in all kernels
    predict_mean_one(0, work.before, F, 0, work.x, nn)
    predict_covariance_one(0, work.P_before, F, Q, 0, work.T, work.P, nn)
    look_one(0, work.x, work.aimed, rules, work.h, work.H)


@inlined
def track_target(live, here, rows, t, rules, work, x_out, P_out, nn):
    """Update the prediction of target t with z and R, and store it; a target that is not here stays as it was."""
    if rules.folding:
        unfold_lanes(live, work.P, work.z, work.R, work.h, work.H, work.own_view[2], rules, nn)
    track_lanes(
        live, here, work.x, work.P, work.z, work.R, work.h, work.H, work.aimed, rules, work.y, work.d, work.v, nn
    )  # fmt: skip
    for a in range(len(nn)):
        work.x[0, a] = where(here, work.x[0, a], work.before[0, a])
        for b in range(len(nn)):
            work.P[0, a, b] = where(here, work.P[0, a, b], work.P_before[0, a, b])
    scatter_part(x_out, (rows, t), work.x[0])
    scatter_part(P_out, (rows, t), work.P[0])


@inlined
def move_target(here, rows, k, t, truth, process, F, L, true, moved, push, truth_out, nn):
    """Move target t of truth (e, t, n): fills moved (1, n) and truth_out; one that is not here stays where it was."""
    gather_part(truth, (rows, t), true[0])
    gather_part(process, (rows, k, t), push[0])
    move_one(0, true, F, L, push, moved, nn)
    for a in range(len(nn)):
        moved[0, a] = where(here, moved[0, a], true[0, a])
    scatter_part(truth_out, (rows, t), moved[0])


@inlined
def load_errors(rows, k, t, error, work):
    """Fill z with the errors of target t in step k, from error (e, k, p, t, 3)."""
    for j in range(len(work.error)):
        gather_part(error, (rows, k, j, t), work.error[j])
        for q in range(3):
            work.z[3 * j + q] = work.error[j, q]


@kernel
def transition(
    step, mean, P, truth, unseen, process, error, settings, true_F, true_L, true_rules, F, Q, places, fence, rules,
    stay, x_out, P_out, truth_out, received, unseen_out, share, nn, pp
):  # fmt: skip
    """One step of every environment; mean, truth (e, t, n), P (e, t, n, n), received, unseen (e, t), share (e,).

    What is not in the scene stays as it is.
    """
    count, targets = mean.shape[:2]
    work, true_view = work_for(nn, pp), empty_view(pp)
    true, moved, push = empty_lanes((ONE, nn)), empty_lanes((ONE, nn)), empty_lanes((ONE, nn))
    for first in range(0, count, LANES):
        live, rows = min(LANES, count - first), rows_from(first, count)
        k = gathered(step, (rows,))
        load_settings(settings, rows, places, rules, work)
        view_all(0, work.settings, true_rules, *true_view)
        # The next environments' tapes, because those of a batch are larger than the processor's cache. The end of every
        # second target's numbers will do: a line of 64 bytes holds two, and the step before loaded the line before.
        ahead = rows_from(first + LANES, count)
        for t in range(targets - 1, -1, -2):
            prefetch(process, (ahead, k, t, len(nn) - 1))
            for j in range(len(pp)):
                prefetch(error, (ahead, k, j, t, 2))
        least = np.inf + 0.0 * k
        for t in range(targets):
            here = is_here(t, k + 1.0, stay)
            move_target(here, rows, k, t, truth, process, true_F, true_L, true, moved, push, truth_out, nn)
            predict_target(rows, t, mean, P, F, Q, rules, work, nn)
            information = information_one(0, work.P, work.h, work.H, *work.own_view, fence, rules)
            least = where(here, min(least, information), least)
            load_errors(rows, k, t, error, work)
            got = receive_one(
                0, moved, work.h, work.z, work.aimed, work.own_view, true_view, fence, rules, true_rules, work.z, work.R
            )  # fmt: skip
            scatter(received, (rows, t), where(here, got, 0.0))
            scatter(unseen_out, (rows, t), where(here & (got == 0.0), gathered(unseen, (rows, t)) + 1.0, 0.0))
            track_target(live, here, rows, t, rules, work, x_out, P_out, nn)
        scatter(share, (rows,), where(least < np.inf, least, 0.0))  # an empty scene


@kernel
def move(step, truth, process, F, L, stay, truth_out, nn):
    """Fill truth_out (e, t, n): all targets in the scene one step on."""
    count, targets = truth.shape[:2]
    true, moved, push = empty_lanes((ONE, nn)), empty_lanes((ONE, nn)), empty_lanes((ONE, nn))
    for first in range(0, count, LANES):
        rows = rows_from(first, count)
        k = gathered(step, (rows,))
        for t in range(targets):
            here = is_here(t, k + 1.0, stay)
            move_target(here, rows, k, t, truth, process, F, L, true, moved, push, truth_out, nn)


@kernel
def receive(
    step, mean, P, truth, error, settings, true_rules, F, Q, places, fence, rules, stay, z, R, share, nn, pp
):  # fmt: skip
    """Fill z, R (e, t, a), what the platforms measure of truth (e, t, n), and share (e,), the least information."""
    count, targets = mean.shape[:2]
    work, true_view, true = work_for(nn, pp), empty_view(pp), empty_lanes((ONE, nn))
    for first in range(0, count, LANES):
        rows = rows_from(first, count)
        k = gathered(step, (rows,))
        load_settings(settings, rows, places, rules, work)
        view_all(0, work.settings, true_rules, *true_view)
        least = np.inf + 0.0 * k
        for t in range(targets):
            here = is_here(t, k + 1.0, stay)
            gather_part(truth, (rows, t), true[0])
            predict_target(rows, t, mean, P, F, Q, rules, work, nn)
            information = information_one(0, work.P, work.h, work.H, *work.own_view, fence, rules)
            least = where(here, min(least, information), least)
            load_errors(rows, k, t, error, work)
            receive_one(
                0, true, work.h, work.z, work.aimed, work.own_view, true_view, fence, rules, true_rules, work.z, work.R
            )  # fmt: skip
            for a in range(len(work.z)):
                work.z[a], work.R[a] = where(here, work.z[a], 0.0), where(here, work.R[a], np.inf)
            scatter_part(z, (rows, t), work.z)
            scatter_part(R, (rows, t), work.R)
        scatter(share, (rows,), where(least < np.inf, least, 0.0))


@kernel
def track(step, mean, P, z, R, settings, F, Q, places, rules, stay, x_out, P_out, nn, pp):
    """Fill x_out (e, t, n), P_out (e, t, n, n): one step of the tracker with measurements z of variances R (e, t, a).

    settings (e, p, 4): those that the measurements were made with.
    """
    (count, targets, _), work = mean.shape, work_for(nn, pp)
    for first in range(0, count, LANES):
        live, rows = min(LANES, count - first), rows_from(first, count)
        load_settings(settings, rows, places, rules, work)
        for t in range(targets):
            here = is_here(t, gathered(step, (rows,)) + 1.0, stay)
            predict_target(rows, t, mean, P, F, Q, rules, work, nn)
            gather_part(z, (rows, t), work.z)
            gather_part(R, (rows, t), work.R)
            track_target(live, here, rows, t, rules, work, x_out, P_out, nn)


@kernel
def observe(mean, P, looks, F, Q, places, rules, out, nn, pp):
    """out (e, elements): the observation before its logarithm is taken; variances in place of standard deviations.

    For every target, as predicted one step ahead: variances of position and velocity, then for each platform
    |(r, rdot, azimuth)|, each followed by its variance.
    """
    (count, targets, _), work = mean.shape, work_for(nn, pp)
    for first in range(0, count, LANES):
        rows, column = rows_from(first, count), 0
        for j in range(len(pp)):
            work.aimed[j, 0], work.aimed[j, 1], work.aimed[j, 2] = (
                places[j, 0],
                places[j, 1],
                gathered(looks, (rows, j)),
            )
        for t in range(targets):
            predict_target(rows, t, mean, P, F, Q, rules, work, nn)
            scatter(out, (rows, column), work.P[0, 0, 0] + work.P[0, 2, 2])
            scatter(out, (rows, column + 1), work.P[0, 1, 1] + work.P[0, 3, 3])
            column += 2
            for a in range(len(work.h)):
                spread = spread_of(a % 3, 0, work.P, work.H, a)
                scatter(out, (rows, column), max(abs(work.h[a]), FAINT))
                scatter(out, (rows, column + 1), max(spread, FAINT * FAINT))
                column += 2


@inlined
def measure_target(rows, t, mean, P, truth, V, L, d, x, nn):
    """Position error, position variance and NEES e' P^-1 e of target t; V, L, d and x are scratch space."""
    gather_part(mean, (rows, t), d)
    gather_part(truth, (rows, t), x)
    gather_part(P, (rows, t), V[0])
    for a in range(len(nn)):
        d[a] -= x[a]
    away = np.sqrt(d[0] * d[0] + d[2] * d[2])
    return away, V[0, 0, 0] + V[0, 2, 2], squared_mahalanobis_one(0, d, V, L, nn)


@kernel
def measure(mean, P, truth, values, nn):
    """The figures of every target: position error, position variance and NEES e' P^-1 e; values (3, e, t)."""
    (count, targets, _), d, x = mean.shape, empty_lanes((nn,)), empty_lanes((nn,))
    V, L = empty_lanes((ONE, nn, nn)), empty_lanes((nn, nn))
    for first in range(0, count, LANES):
        rows = rows_from(first, count)
        for t in range(targets):
            found = measure_target(rows, t, mean, P, truth, V, L, d, x, nn)
            for q in range(3):
                scatter(values, (q, rows, t), found[q])


@kernel
def figures(step, mean, P, truth, unseen, share, stay, come_and_go, threshold, longest, values, flags, below, nn):
    """The figures of a state: values (3, e, t) of ``measure``, 0 for a target that is not in the scene.

    flags (2, e, t): whether a target is lost, as nothing was received for more than ``longest`` steps, and whether it
    is in the scene, as all are unless they ``come_and_go``. below (e,): whether ``share``, the least information of
    targets in the scene, lies below the threshold.
    """
    measure(mean, P, truth, values, nn)
    for e in range(mean.shape[0]):
        some = False
        for t in range(mean.shape[1]):
            here = not come_and_go or is_here(t, step[e], stay)
            flags[0, e, t], flags[1, e, t], some = unseen[e, t] > longest, here, some or here
            if not here:
                values[0, e, t], values[1, e, t], values[2, e, t] = 0.0, 0.0, 0.0
        below[e] = some and step[e] > 0 and share[e] < threshold
