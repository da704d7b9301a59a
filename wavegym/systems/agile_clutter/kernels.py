"""One compiled step of the agile-clutter loop: predict, transmit, detect, associate, update.

Axes: e environment, i sensor, t target slot. Sizes arrive as tuples of zeros (``nn`` for the state).
``targets`` = (birth (t,) int, lifetime) says when a slot holds a target: birth < step <= birth + lifetime.
``radar`` is a ``Radar`` as the tracker assumes it. ``world`` has the true values; its gate and gate probability are not
used. ``pulse`` is a ``state.Pulse`` whose axes env and candidate are one flat axis e, which may be 1 for all
environments. No gate is opened if its chance is 0 or if the predicted echo arrives while the pulse is sent.
``q2`` = (pd grid, log clutter grid, table) of the information reduction factor.
``gates`` = (open (g,) bool, centre (g, 2), L (g, 2, 2), radius): one for each target, or one for each component of
each target. The windows of a sensor are WINDOW times as large as the gates that are predicted before the step.
``measure`` reports the returns inside the windows, and ``track`` drops those outside the tracker's gates. A target is
``fresh`` (t,) bool until a sensor of the step illuminates it; its gates are then those predicted before the step.
Returns outside the gates and clutter points are counted for fresh targets only: ``measure`` does not know later gates.
``particles`` = (X (e, particle, t, n), V (e, particle, t, n, n)); ``mixtures`` = (weight (e, t, c), X (e, t, c, n),
V (e, t, c, n, n)); ``jpda`` = True. One of the three is the tracker, and the others are None. The compiler omits a
block under ``is not None``, and only such a block.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri

from wavegym.core.array_kernels import copy_vector
from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.clutter_kernels import add_clutter, in_a_gate, in_gate, most_load, room
from wavegym.sensors.detection_kernels import EchoLaw, detection_of, effective_snr, inverse_snr, received_snr
from wavegym.sensors.eclipsing_kernels import HALF_C, is_whole, windowed_covariance
from wavegym.sensors.geometry_kernels import range_and_rate
from wavegym.sensors.scatterers_kernels import noise_with_clutter
from wavegym.trackers import gaussian_mixture_kernels as gaussian_mixture
from wavegym.trackers.jpda_kernels import factor_one, update_targets
from wavegym.trackers.kernels import predict_covariance_one, predict_mean_one
from wavegym.trackers.rbpf_kernels import copy_one, mixture, normalise, predict_particles, resample, update_particles
from wavegym.trackers.ukf_kernels import predict_measurement_one

MOST_CLUTTER = 1e6
"""Expected points in one gate; a step that exceeds this limit stops, and its clutter count is NaN."""
WINDOW = 3.0
"""Radius of a window over that of a gate. Scans of I sensors, each in its gate, lie within sqrt(I) times the gates that
are predicted before; the rest is for the spread of competing returns, which widens the gates of the later sensors."""
LEAST_SEEN = 0.02
"""Least share of an echo's energy that a receiver detects. The tails of a pulse, which leave 1 % of it, are no echo."""
RATES = ndtri((np.arange(13) + 0.5) / 13.0)
PLACES = np.stack([RATES / np.sqrt(np.mean(RATES**2)), (5 * np.arange(13) % 13 + 0.5) / 13.0], axis=1)
"""Equally likely pairs of a standard normal range-rate and a share of textures, on a lattice. Doppler filters have
nulls a few m/s apart, over which Gauss-Hermite nodes, few and far apart, have a larger error."""
LEAST_DENSITY = 1e-20
"""The tracker's clutter density where the true one is 0: a return in a gate is then always a target's."""


class Radar(NamedTuple):
    """The sensors, their laws and the clutter."""

    sensors: Any  # (i, 2), m
    reference: float  # range at which eta = 1, m
    nearest: float  # least range of the law of SNR, m
    law: EchoLaw  # a row for each threshold
    noise: Any  # (row,) peaks of noise per resolution cell: their density times sqrt(det C)
    clutter: float  # density of false returns of other origin, per m and m/s
    gate: float
    gate_probability: float
    carrier: float  # Hz
    tables: Any  # of pulses that are cut
    field: Any  # ClutterField of scatterers, a row for each waveform; or None


@inlined
def row(e, array):
    """The row of ``array`` that belongs to environment e."""
    return e if len(array) > 1 else 0


@inlined
def weakness_one(e, i, r, strength, radar):
    """1 / eta of a whole pulse's echo from range r."""
    return inverse_snr(r, radar.reference, radar.nearest) / strength[row(e, strength), i]


@kernel
def echo(r, C00, C01, C11, w, windows, radar):
    """(share, C00, C01, C11) of pulse w's echo from range r: visible share of the energy, C of the visible part.

    Both C are at unit SNR of the *whole* pulse. The share is 0 below LEAST_SEEN.
    """
    if is_whole(windows, w, abs(r) / HALF_C):
        return 1.0, C00, C01, C11
    share, R00, R01, R11 = windowed_covariance(radar.tables, windows, w, abs(r), radar.carrier)
    return share if share >= LEAST_SEEN else 0.0, R00, R01, R11


@inlined
def echo_of(e, i, r, pulse, radar):
    """``echo`` of sensor i's pulse."""
    C, own, w = pulse.C, row(e, pulse.C), pulse.window[row(e, pulse.window), i]
    return echo(r, C[own, i, 0, 0], C[own, i, 1, 0], C[own, i, 1, 1], w, pulse.windows, radar)


@inlined
def alarm_of(e, i, pulse):
    """Row of sensor i's threshold."""
    return pulse.alarm[row(e, pulse.alarm), i]


@kernel
def expected_echo(r, v, V, weakness, C00, C01, C11, w, windows, alarm, radar):
    """(Pd, R00, R01, R11) of pulse w's echo from range r, as predicted: R is the mean of detected echoes.

    The range-rate is normal with mean v and variance V; only scatterers make a difference between range-rates. C is
    that of the whole pulse at unit SNR, and 1 / weakness its eta in noise. Pd is 0 if no part of the echo is visible.
    """
    share, C00, C01, C11 = echo(r, C00, C01, C11, w, windows, radar)
    if share == 0.0:
        return 0.0, C00, C01, C11
    pd, effective = detected(share / weakness, r, v, V, windows[w, -1], alarm, radar.field, radar.law)
    spread = share / effective
    return pd, spread * C00, spread * C01, spread * C11


@kernel
def detected(eta, r, v, V, waveform, alarm, field, law):
    """(Pd, effective eta of detected echoes) of an echo of SNR eta in noise alone, over range-rates as predicted."""
    pd, effective = detection_of(eta, alarm, law), effective_snr(eta, alarm, law)
    if field is not None:
        pd = error = 0.0
        for n in range(len(PLACES)):
            own = eta / noise_with_clutter(field, waveform, r, v + np.sqrt(V) * PLACES[n, 0], PLACES[n, 1])
            seen = detection_of(own, alarm, law) / len(PLACES)
            pd += seen
            error += seen / effective_snr(own, alarm, law)
        effective = pd / error
    return pd, effective


@inlined
def expected_echo_of(e, i, r, v, V, pulse, radar):
    """``expected_echo`` of sensor i's pulse."""
    C, own, w = pulse.C, row(e, pulse.C), pulse.window[row(e, pulse.window), i]
    return expected_echo(
        r, v, V, weakness_one(e, i, r, pulse.strength, radar), C[own, i, 0, 0], C[own, i, 1, 0], C[own, i, 1, 1],
        w, pulse.windows, alarm_of(e, i, pulse), radar
    )  # fmt: skip


@inlined
def false_density(C00, C01, C11, alarm, radar):
    """Density of a pulse's false returns: clutter, and peaks of noise, whose number in a resolution cell is fixed."""
    return radar.clutter + radar.noise[alarm] / np.sqrt(C00 * C11 - C01 * C01)


@inlined
def density_of(e, i, pulse, radar):
    """``false_density`` of sensor i's pulse."""
    C, own = pulse.C, row(e, pulse.C)
    return false_density(C[own, i, 0, 0], C[own, i, 1, 0], C[own, i, 1, 1], alarm_of(e, i, pulse), radar)


@kernel
def is_lit(e, i, present, chance, lit):
    """lit (t,): whether each slot holds a target that sensor i illuminates and may detect."""
    for t in range(len(present)):
        lit[t] = present[t] and chance[row(e, chance), i, t] > 0.0


@kernel
def is_present(step, birth, lifetime, present):
    """present (t,): whether each slot holds a target at ``step``."""
    for t in range(len(birth)):
        present[t] = birth[t] < step <= birth[t] + lifetime


@kernel
def predict_targets(e, mean, covariance, present, F, Q, x, P, nn):
    """x (t, n), P (t, n, n): the belief of environment e one step later; slots without a target do not change."""
    n = len(nn)
    T = np.empty((n, n))
    for t in range(len(present)):
        for i in range(n):
            x[t, i] = mean[e, t, i]
            for j in range(n):
                P[t, i, j] = covariance[e, t, i, j]
        if present[t]:
            y = x.copy()
            predict_mean_one(t, y, F, 0, x, nn)
            predict_covariance_one(t, P, F, Q, 0, T, P, nn)


@kernel
def workspace(count_t, nn):
    """Arrays of one sensor's scan; axis t is first: (predicted measurement, S, its factor L, Pxz, N, Pd, scratch)."""
    n = len(nn)
    return (
        np.empty((count_t, 2)), np.empty((count_t, 2, 2)), np.empty((count_t, 2, 2)), np.empty((count_t, n, 2)),
        np.empty((count_t, 2, 2)), np.empty(count_t), np.empty((count_t, n, n)),
    )  # fmt: skip


@kernel
def predict_scan(e, i, x, P, lit, pulse, radar, work, nn):
    """Fill ``work`` with sensor i's predicted measurements: S = Pzz + N at predicted ranges.

    A target is no longer lit if no part of its echo is predicted to be visible.
    """
    centre, S, L, G, N, pd, scratch = work
    sensors, chance = radar.sensors, pulse.chance
    for t in range(len(lit)):
        if lit[t]:
            predict_measurement_one(t, t, x, P, sensors[i, 0], sensors[i, 1], scratch, centre, S, G, nn)
            seen, N[t, 0, 0], N[t, 0, 1], N[t, 1, 1] = expected_echo_of(
                e, i, centre[t, 0], centre[t, 1], S[t, 1, 1], pulse, radar
            )
            N[t, 1, 0] = N[t, 0, 1]
            lit[t] = seen > 0.0
            pd[t] = chance[row(e, chance), i, t] * seen
            for a in range(2):
                for b in range(2):
                    S[t, a, b] += N[t, a, b]
            factor_one(t, S, L)


@kernel
def receive(e, i, k, key, lit, fresh, truth, error, pulse, world, gates, reach, z, outside, scan):
    """Fill z with the returns of targets that lie within ``reach`` times a gate; returns their number.

    outside[e, t] counts the returns of a fresh target outside its own gates, if it has gates; scan[e, 0] counts
    detections. The world's eta at the true range is the mean of the realised SNR, which decides on the detection and
    the errors; its draws belong to ``key``.
    """
    sensors, alarm = world.sensors, alarm_of(e, i, pulse)
    opened, centre, L, gate = gates
    waveform = pulse.windows[pulse.window[row(e, pulse.window), i], -1]
    count, each = 0, len(opened) // len(lit)
    for t in range(len(lit)):
        if not lit[t]:
            continue
        r, v = range_and_rate(
            truth[e, t, 0], truth[e, t, 1], truth[e, t, 2], truth[e, t, 3], sensors[i, 0], sensors[i, 1]
        )
        weakness = weakness_one(e, i, r, pulse.strength, world)
        weakness *= noise_with_clutter(world.field, waveform, r, v, uniform(stream(key, len(lit) + t), 0))
        share, C00, C01, C11 = echo_of(e, i, r, pulse, world)
        snr = received_snr(share / weakness, alarm, stream(key, t), world.law) if share > 0.0 else 0.0
        if snr == 0.0:
            continue
        scan[e, 0] += 1
        c0 = np.sqrt(C00)
        c1 = C01 / c0
        c2 = np.sqrt(C11 - c1 * c1)
        spread = np.sqrt(share / snr)
        z0 = r + spread * c0 * error[e, k - 1, i, t, 0]
        z1 = v + spread * (c1 * error[e, k - 1, i, t, 0] + c2 * error[e, k - 1, i, t, 1])
        gated, own, some = False, False, False
        for g in range(len(opened)):
            if opened[g]:
                its = t * each <= g < (t + 1) * each
                gated = gated or its
                if in_gate(g, z0, z1, centre, L, reach * gate):
                    some = True
                    own = own or (its and in_gate(g, z0, z1, centre, L, gate))
        outside[e, t] += fresh[t] and gated and not own
        if some:
            z[count, 0], z[count, 1] = z0, z1
            count += 1
    return count


@kernel
def count_in_fresh_gates(z, begin, end, opened, centre, L, gate, fresh):
    """The number of those of z[begin: end] that lie in a gate of a fresh target."""
    each, own, found = len(opened) // len(fresh), np.empty(len(opened), np.bool_), 0
    for g in range(len(opened)):
        own[g] = opened[g] and fresh[g // each]
    if own.any():
        for m in range(begin, end):
            found += in_a_gate(z[m, 0], z[m, 1], centre, L, own, gate)
    return found


@kernel
def sense(e, i, k, key, echoes, lit, fresh, truth, error, pulse, world, gates, reach, z, outside, scan):
    """Fill z with sensor i's returns and the false ones within ``reach`` times its gates; returns z, or a larger copy.

    ``key`` and ``echoes`` are the keys of the draws of false returns and of echoes.
    The second result is their number. If a gate has too much clutter or no finite size, the number is -1 and scan[e, 1]
    is NaN.
    """
    opened, centre, L, gate = gates
    z = room(z, len(lit))
    returns = receive(e, i, k, echoes, lit, fresh, truth, error, pulse, world, gates, reach, z, outside, scan)
    density = density_of(e, i, pulse, world)
    if not most_load(opened, centre, L, gate, density) <= MOST_CLUTTER:  # NaN, too
        scan[e, 1] = np.nan
        return z, -1
    z, count = add_clutter(key, centre, L, opened, reach * gate, density, z, returns)
    if reach == 1.0 and fresh.all():  # each point lies in a gate
        scan[e, 1] += count - returns
    else:
        scan[e, 1] += count_in_fresh_gates(z, returns, count, opened, centre, L, gate, fresh)
    return z, count


@inlined
def echoes_of(stream_of_step, i, radar):
    """Key of the draws of sensor i's echoes; clutter and particles have the keys before."""
    return stream(stream_of_step, 2 * len(radar.sensors) + 1 + i)


@inlined
def illuminated(lit, fresh):
    """Mark lit targets as no longer fresh."""
    for t in range(len(lit)):
        fresh[t] = fresh[t] and not lit[t]


@inlined
def true_states(e, k, path, birth, lifetime, truth):
    """truth[e] (t, n): the true states at step k; before birth the first state, after the lifetime the last one."""
    for t in range(len(birth)):
        age = min(max(k - birth[t], 0), lifetime)
        for a in range(path.shape[3]):
            truth[e, t, a] = path[e, t, age, a]


@kernel
def move(step, path, targets, truth):
    """truth (e, t, n): the true states one step later."""
    for e in range(len(step)):
        true_states(e, step[e] + 1, path, targets[0], targets[1], truth)


@kernel
def transition(step, mean, covariance, particles, mixtures, jpda, path, first, error, key, pulse, targets,
            world, F, Q, radar, mean_out, covariance_out, particles_out, mixtures_out, truth, outside, scan, every,
            nn):  # fmt: skip
    """One step of every environment, sensor after sensor; tapes are read at [e, step]. F and Q are the tracker's.

    mean and covariance are moments of the particles or mixtures, if there are any. outside (e, t) is incremented. scan
    (e, 4): detections, clutter points (NaN for too many), effective sample size, distinct ancestors. If ``every``
    (bool) is True, every sensor counts returns outside its gates and clutter points.
    """
    (birth, lifetime), sensors, count_t, n = targets, radar.sensors, len(targets[0]), len(nn)
    present, lit, fresh = np.empty(count_t, np.bool_), np.empty(count_t, np.bool_), np.empty(count_t, np.bool_)
    sent = np.empty(count_t, np.bool_)
    work, z = workspace(count_t, nn), np.empty((64, 2))
    bank, opened = bank_of(mixtures, nn)
    cloud = cloud_of(particles, count_t, nn)
    x, P = np.empty((count_t, n)), np.empty((count_t, n, n))
    for e in range(len(step)):
        k = step[e] + 1
        stream_of_step = stream(key[e], k)
        true_states(e, k, path, birth, lifetime, truth)
        is_present(k, birth, lifetime, present)
        predict_targets(e, mean, covariance, present, F, Q, x, P, nn)
        fresh[:] = True
        predict_hypotheses(e, particles, mixtures, present, F, Q, cloud, mixtures_out, nn)
        for i in range(len(sensors)):
            is_lit(e, i, present, pulse.chance, sent)
            copy_vector(sent, lit)
            predict_scan(e, i, x, P, lit, pulse, radar, work, nn)
            gates = gates_of(e, i, mixtures_out, lit, radar, work, bank, opened, nn)
            z, count = sense(
                e, i, k, stream(stream_of_step, i), echoes_of(stream_of_step, i, radar), sent, fresh, truth, error,
                pulse, world, gates, 1.0, z, outside, scan
            )  # fmt: skip
            if count < 0:
                break
            if not every:
                illuminated(lit, fresh)
            track(
                e, i, stream_of_step, present, lit, x, P, particles, cloud, mixtures_out, jpda, z, count, pulse,
                radar, work, bank, nn
            )  # fmt: skip
        if particles is not None:
            Y, U, log_weight, weight = cloud
            scan[e, 2] = normalise(log_weight, weight)
            own = stream(stream_of_step, 2 * len(sensors))
            scan[e, 3] = resample(own, weight, Y, U, particles_out[0][e], particles_out[1][e], nn)
        for t in range(count_t):
            copy_one(t, x, P, mean_out[e], covariance_out[e], nn)
            if k == birth[t]:
                hand_over(e, t, first, mean_out, particles_out, mixtures_out, nn)


@inlined
def gates_of(e, i, mixtures, lit, radar, work, bank, opened, nn):
    """Sensor i's gates in environment e: those in ``work``, or with mixtures those of their components."""
    gates = lit, work[0], work[2], radar.gate
    if mixtures is not None:
        sx, sy = radar.sensors[i, 0], radar.sensors[i, 1]
        gaussian_mixture.predict_bank(mixture_at(e, mixtures), lit, work[4], sx, sy, bank, opened, nn)
        gates = opened, bank[0], bank[1], radar.gate
    return gates


@kernel
def measure(step, mean, covariance, mixtures, ahead, truth, error, key, pulse, targets, world, F, Q, radar,
            count, outside, scan, nn):  # fmt: skip
    """Returns of all sensors in their windows, (return, 2), environment by environment and sensor by sensor.

    The returns of a sensor are sorted by range, so that their order does not reveal which are from targets. count (e,
    i) is their number. outside (e, t) and scan (e, 2) are incremented as in ``transition``. ``ahead`` is filled with
    the predicted mixtures.
    """
    (birth, lifetime), sensors, count_t, n, filled = targets, radar.sensors, len(targets[0]), len(nn), 0
    present, lit, fresh = np.empty(count_t, np.bool_), np.empty(count_t, np.bool_), np.empty(count_t, np.bool_)
    sent = np.empty(count_t, np.bool_)
    work, z, found = workspace(count_t, nn), np.empty((64, 2)), np.empty((64, 2))
    x, P = np.empty((count_t, n)), np.empty((count_t, n, n))
    bank, opened = bank_of(mixtures, nn)
    for e in range(len(step)):
        k = step[e] + 1
        stream_of_step = stream(key[e], k)
        fresh[:] = True
        is_present(k, birth, lifetime, present)
        predict_targets(e, mean, covariance, present, F, Q, x, P, nn)
        predict_hypotheses(e, None, mixtures, present, F, Q, None, ahead, nn)
        for i in range(len(sensors)):
            is_lit(e, i, present, pulse.chance, sent)
            copy_vector(sent, lit)
            predict_scan(e, i, x, P, lit, pulse, radar, work, nn)
            gates = gates_of(e, i, ahead, lit, radar, work, bank, opened, nn)
            z, count[e, i] = sense(
                e, i, k, stream(stream_of_step, i), echoes_of(stream_of_step, i, radar), sent, fresh, truth, error,
                pulse, world, gates, WINDOW, z, outside, scan
            )  # fmt: skip
            if count[e, i] < 0:
                break
            illuminated(lit, fresh)
            found = room(found, filled + count[e, i])
            for m in np.argsort(z[: count[e, i], 0]):
                found[filled, 0], found[filled, 1] = z[m, 0], z[m, 1]
                filled += 1
    return found[:filled]


@kernel
def track_returns(step, mean, covariance, mixtures, jpda, z, count, first, pulse, targets, F, Q, radar, mean_out,
            covariance_out, mixtures_out, nn):  # fmt: skip
    """One step of JPDA or of the mixtures with the returns z[e, i, : count[e, i]] (e, i, m, 2)."""
    (birth, lifetime), sensors, count_t, n = targets, radar.sensors, len(targets[0]), len(nn)
    present, lit = np.empty(count_t, np.bool_), np.empty(count_t, np.bool_)
    work, inside = workspace(count_t, nn), np.empty((z.shape[2], 2))
    bank, opened = bank_of(mixtures, nn)
    x, P = np.empty((count_t, n)), np.empty((count_t, n, n))
    for e in range(len(step)):
        k = step[e] + 1
        is_present(k, birth, lifetime, present)
        predict_targets(e, mean, covariance, present, F, Q, x, P, nn)
        predict_hypotheses(e, None, mixtures, present, F, Q, None, mixtures_out, nn)
        for i in range(len(sensors)):
            is_lit(e, i, present, pulse.chance, lit)
            predict_scan(e, i, x, P, lit, pulse, radar, work, nn)
            gates = gates_of(e, i, mixtures_out, lit, radar, work, bank, opened, nn)
            kept = keep_in_gates(z[e, i], count[e, i], gates, inside)
            track(
                e, i, np.uint64(0), present, lit, x, P, None, None, mixtures_out, jpda, inside, kept, pulse, radar,
                work, bank, nn
            )  # fmt: skip
        for t in range(count_t):
            copy_one(t, x, P, mean_out[e], covariance_out[e], nn)
            if k == birth[t]:
                hand_over(e, t, first, mean_out, None, mixtures_out, nn)


@kernel
def keep_in_gates(z, count, gates, inside):
    """Copy the returns of z[: count] that lie in a gate to ``inside``, in the same order; returns their number."""
    opened, centre, L, gate = gates
    kept = 0
    for m in range(count):
        if in_a_gate(z[m, 0], z[m, 1], centre, L, opened, gate):
            inside[kept, 0], inside[kept, 1] = z[m, 0], z[m, 1]
            kept += 1
    return kept


@kernel
def noise_of_returns(i, z, pulse, radar, R):
    """R (e, m, 2, 2) of sensor i's pulse, as predicted at the ranges of its returns z (e, m, 2)."""
    for e in range(len(z)):
        for m in range(z.shape[1]):
            r, v = z[e, m]
            _, R[e, m, 0, 0], R[e, m, 0, 1], R[e, m, 1, 1] = expected_echo_of(e, i, r, v, 0.0, pulse, radar)
            R[e, m, 1, 0] = R[e, m, 0, 1]


@kernel
def densities(i, pulse, radar, density):
    """density (e,) of sensor i's false returns, as the tracker takes it."""
    for e in range(len(density)):
        density[e] = max(density_of(e, i, pulse, radar), LEAST_DENSITY)


@kernel
def assume(i, step, mean, covariance, pulse, targets, radar, lit_out, noise, pd, nn):
    """What the tracker assumes about sensor i's measurement, given the current estimate.

    lit_out (e, t) bool: whether the target may be detected. noise (e, t, 2, 2) is the covariance of its error and pd
    (e, t) its detection probability, both at the predicted range; else 0.
    """
    present, work = np.empty(lit_out.shape[1], np.bool_), workspace(lit_out.shape[1], nn)
    for e in range(len(step)):
        is_present(step[e] + 1, targets[0], targets[1], present)
        is_lit(e, i, present, pulse.chance, lit_out[e])
        predict_scan(e, i, mean[e], covariance[e], lit_out[e], pulse, radar, work, nn)
        for t in range(len(present)):
            pd[e, t] = work[5][t] if lit_out[e, t] else 0.0
            for a in range(2):
                for b in range(2):
                    noise[e, t, a, b] = work[4][t, a, b] if lit_out[e, t] else 0.0


@inlined
def mixture_at(e, mixtures):
    """The mixtures of environment e."""
    return mixtures[0][e], mixtures[1][e], mixtures[2][e]


@inlined
def predict_hypotheses(e, particles, mixtures, present, F, Q, cloud, mixtures_out, nn):
    """Predict environment e's particles to ``cloud``, or its mixtures to ``mixtures_out``, if there are any."""
    if particles is not None:
        predict_particles(particles[0][e], particles[1][e], present, F, Q, cloud[0], cloud[1], nn)
        cloud[2][:] = 0.0
    if mixtures is not None:
        gaussian_mixture.predict_mixtures(mixture_at(e, mixtures), present, F, Q, mixture_at(e, mixtures_out), nn)


@kernel
def cloud_of(particles, targets, nn):
    """Arrays of one environment's particles (None without particles): X, V, log weight and weight."""
    count, n = 0, len(nn)
    if particles is not None:
        count = particles[0].shape[1]
    return np.empty((count, targets, n)), np.empty((count, targets, n, n)), np.empty(count), np.empty(count)


@kernel
def bank_of(mixtures, nn):
    """Arrays of one sensor's scan (None without mixtures): the bank and ``opened`` of the components of all targets."""
    count = 0
    if mixtures is not None:
        count = mixtures[0].shape[1] * mixtures[0].shape[2]
    return gaussian_mixture.workspace(count, nn), np.empty(count, np.bool_)


@kernel
def hand_over(e, t, first, mean, particles, mixtures, nn):
    """Set the means of the belief, of every particle and of every component to target t's first estimate."""
    for a in range(len(nn)):
        mean[e, t, a] = first[e, t, a]
        if particles is not None:
            for j in range(particles[0].shape[1]):
                particles[0][e, j, t, a] = first[e, t, a]
        if mixtures is not None:
            for c in range(mixtures[1].shape[2]):
                mixtures[1][e, t, c, a] = first[e, t, a]


@kernel
def track(e, i, own, present, lit, x, P, particles, cloud, mixtures, jpda, z, count, pulse, radar, work, bank, nn):
    """Update the belief x (t, n), P (t, n, n) of environment e with sensor i's scan z[: count].

    The tracker is the particles in ``cloud``, mixtures, or JPDA. x and P are the moments of particles or mixtures.
    ``own``: the environment's random numbers in this step.
    """
    centre, S, L, G, _, pd, _ = work
    density = max(density_of(e, i, pulse, radar), LEAST_DENSITY)
    gate, gate_probability = radar.gate, radar.gate_probability
    if mixtures is not None:
        mixture_of = mixture_at(e, mixtures)
        gaussian_mixture.update_mixtures(
            lit, mixture_of, z, count, pd, bank, gate, gate_probability, density, gaussian_mixture.NEGLIGIBLE, nn
        )
        gaussian_mixture.moments(mixture_of, present, x, P, nn)
    if particles is not None:
        track_particles(i, own, present, lit, x, P, cloud, z, count, density, radar, work, nn)
    if jpda is not None:
        update_targets(lit, x, P, z, count, pd, centre, L, S, G, gate, gate_probability, density, nn)


@kernel
def track_particles(i, own, present, lit, x, P, cloud, z, count, density, radar, work, nn):
    """Update the particles of ``cloud``, and their moments x (t, n), P (t, n, n), with sensor i's scan z[: count]."""
    (centre, _, L, _, N, pd, _), (Y, U, log_weight, weight) = work, cloud
    sensors, gate, gate_probability = radar.sensors, radar.gate, radar.gate_probability
    update_particles(
        stream(own, len(sensors) + i), lit, Y, U, log_weight, z, count, pd, N, sensors[i, 0], sensors[i, 1],
        (centre, L, gate, gate_probability), density, nn
    )  # fmt: skip
    normalise(log_weight, weight)
    mixture(weight, Y, U, present, x, P, nn)
