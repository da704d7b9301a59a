"""Kernels of the urban loop: a scan (targets over all paths, clutter), its signals, observation, cost and key figures.

Shapes of tracks: e environments, s slots, t targets, M models, n = 6 states; x (e, s, M, n), P (e, s, M, n, n), mu
(e, s, M). ``state_info`` of the system explains the key figures.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from wavegym.core.counter_rng_kernels import exponential, normal, stream, uniform
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.detection_kernels import CELL, EchoLaw, received_snr
from wavegym.sensors.geometry_kernels import (
    direction_cosine,
    direction_variance,
    folded,
    multistatic_acceleration,
    multistatic_range_and_rate,
    noise,
    snr_at,
)
from wavegym.sensors.receiver_kernels import add_echoes, add_noise, path_delays
from wavegym.systems.urban.tracker_kernels import CONFIRMED, EMPTY
from wavegym.trackers.imm_kernels import combine_one

ERRORS = 0  # number of the stream of the errors of a path
CLUTTER = 10_000  # number of the random stream of clutter; paths have smaller numbers
DRIVERS = 40_000  # number of the stream of the targets' random accelerations
NOISE = 20_000  # number of the noise stream of a scan; paths have smaller numbers
BACKGROUND = 30_000  # number of the stream of the recorded background; scans have smaller numbers


class SensorLaw(NamedTuple):
    """Constants of the receivers' measurements in the world."""

    density: float  # expected false returns per (m x m/s)
    echo: EchoLaw
    rate_floor: float  # standard deviation of range-rate in addition to its noise, m/s
    reach: float  # half path length beyond which no echo is received, m
    elements: int  # of each array
    limit: float  # greatest unambiguous range-rate, m/s
    kept: Any  # (n,) share of the energy that a train keeps of an echo, at even steps of sqrt(|acceleration|)
    step: float  # of kept, sqrt(m/s^2)


@inlined
def energy_kept(acceleration, law):
    """Share of the energy that a train keeps of an echo with this acceleration along the line of sight, m/s^2."""
    place = min(np.sqrt(abs(acceleration)) / law.step, len(law.kept) - 1 - 1e-9)
    i = int(place)
    return law.kept[i] + (place - i) * (law.kept[i + 1] - law.kept[i])


@kernel
def move_targets(keys, scans, before, route, present, F, g, sigma, after):
    """Fill after (env, target, 6): the targets in scan ``scans[e]``, from ``before``, those of the last scan.

    The state of a target is its place on the route (scan, target, 6) plus a deviation, which starts at 0 when the
    target arrives. F and g: see ``state.deviation_model``. sigma: standard deviation of the random acceleration on each
    axis.
    """
    for e in range(len(keys)):
        scan = scans[e]
        own = stream(stream(keys[e], scan), DRIVERS)
        for t in range(route.shape[1]):
            for i in range(6):
                after[e, t, i] = route[scan, t, i]
            for axis in range(2 if present[scan - 1, t] else 0):
                p, v = (
                    before[e, t, axis] - route[scan - 1, t, axis],
                    before[e, t, axis + 2] - route[scan - 1, t, axis + 2],
                )
                push = sigma * normal(own, 2 * t + axis)
                after[e, t, axis] += F[0, 0] * p + F[0, 1] * v + g[0] * push
                after[e, t, axis + 2] += F[1, 0] * p + F[1, 1] * v + g[1] * push
                after[e, t, axis + 4] += push


@inlined
def report_one(wave, eta, law, R):
    """Fill R (m, m): covariance of a return of this SNR as the receiver reports it, without the floor of range-rate."""
    R[0, 0], R[0, 1], R[1, 1] = noise(wave, eta, 0.0)
    R[1, 0] = R[0, 1]
    if len(R) == 3:
        R[2, 2] = direction_variance(eta, law.elements)


@kernel
def measure_targets(key, scan, pair, targets, scene, law, wave, reference, z, R, count):
    """Append the detections of targets (target, 6) to z[: count]; return the new count.

    The paths are those that are visible from the route. Targets accelerate during the train, which costs energy; the
    range-rate is that at its middle.
    """
    most = scene.path_index.shape[3]
    for g in range(len(targets)):
        x, y, u, v, a, b = targets[g]
        for w in range(scene.path_count[pair, scan, g]):
            tx, ty, sx, sy, ax, ay = scene.images[pair, scene.path_index[pair, scan, g, w]]
            r, rate = multistatic_range_and_rate(x, y, u, v, tx, ty, sx, sy)
            if r > law.reach or count >= len(z):
                continue
            own = stream(key, g * most + w)
            kept = energy_kept(multistatic_acceleration(x, y, u, v, a, b, tx, ty, sx, sy), law)
            eta = kept * snr_at(r, reference, scene.reflected[pair, scan, g, w])
            eta, errors = received_snr(eta, 0, own, law.echo), stream(own, ERRORS)
            if eta > 0.0:
                R00, R01, R11 = noise(wave, eta, law.rate_floor)
                L00, n0, n1 = np.sqrt(R00), normal(errors, 0), normal(errors, 1)
                L10 = R01 / L00
                z[count, 0] = r + L00 * n0
                z[count, 1] = folded(rate + L10 * n0 + np.sqrt(R11 - L10 * L10) * n1, law.limit)
                if z.shape[1] == 3:
                    spread = np.sqrt(direction_variance(eta, law.elements))
                    z[count, 2] = folded(direction_cosine(x, y, sx, sy, ax, ay) + spread * normal(errors, 2), 1.0)
                report_one(wave, eta, law, R[count])
                count += 1
    return count


@kernel
def measure_clutter(key, law, wave, z, R, count):
    """Append false returns, uniform in all measured quantities, to z[: count]; return the new count."""
    own, expected, sum_of_gaps, i = stream(key, CLUTTER), law.density * law.reach * 2.0 * law.limit, 0.0, 0
    while count < len(z):
        sum_of_gaps += exponential(own, 3 * i)
        if sum_of_gaps > expected:
            break
        z[count, 0] = law.reach * uniform(own, 3 * i + 1)
        z[count, 1] = law.limit * (2.0 * uniform(own, 3 * i + 2) - 1.0)
        if z.shape[1] == 3:
            z[count, 2] = 2.0 * uniform(stream(key, CLUTTER + 1), i) - 1.0
        report_one(wave, 2.0 * (law.echo.threshold[0] + exponential(stream(key, CLUTTER + 2), i)), law, R[count])
        count, i = count + 1, i + 1
    return count


@kernel
def measure(keys, scans, targets, scene, law, wave, reference, z, R, count):
    """Scan ``scans[e]`` of every environment e with its targets (env, target, 6).

    Fills z (env, pair, measurement, m) and count (env, pair). wave (env, pair, 2, 2), reference (env, pair): covariance
    at unit SNR, and SNR at 100 m, of each pair's waveform. A measurement has range, range-rate and, if m = 3, the
    direction cosine at the array of the receiver.
    """
    for e in range(len(keys)):
        for m in range(z.shape[1]):
            key = stream(stream(keys[e], scans[e]), m)
            found = measure_targets(
                key, scans[e], m, targets[e], scene, law, wave[e, m], reference[e, m], z[e, m], R[e, m], 0
            )  # fmt: skip
            count[e, m] = measure_clutter(key, law, wave[e, m], z[e, m], R[e, m], found)


@kernel
def observe(step, x, P, mu, existence, status, age, centre, horizon, out):
    """Write ``urban_fields`` of every environment to out, which is all zeros; positions relative to ``centre`` (2,)."""
    slots, models = mu.shape[1], mu.shape[2]
    mean, variance = np.empty(4), np.empty(4)
    for e in range(len(step)):
        out[e, 0] = 1.0 - step[e] / horizon
        for s in range(slots):
            if status[e, s] == EMPTY:
                continue
            for k in range(4):
                mean[k] = variance[k] = 0.0
                for j in range(models):
                    mean[k] += mu[e, s, j] * x[e, s, j, k]
                for j in range(models):
                    off = x[e, s, j, k] - mean[k]
                    variance[k] += mu[e, s, j] * (P[e, s, j, k, k] + off * off)
            first = 1 + s * (8 + models)
            out[e, first], out[e, first + 1] = existence[e, s], status[e, s] == CONFIRMED
            for k in range(4):
                out[e, first + 2 + k] = mean[k] - centre[k] if k < 2 else mean[k]
            out[e, first + 6] = np.sqrt(variance[0] + variance[1])
            out[e, first + 7] = np.sqrt(variance[2] + variance[3])
            for j in range(models):
                out[e, first + 8 + j] = mu[e, s, j]


@kernel
def fluctuation_draws(keys, scans, draws):
    """Uniform draws of the SNR of each path in scan ``scans[e]`` of environment e, (env, pair, target x slot)."""
    for e in range(len(keys)):
        for m in range(draws.shape[1]):
            own = stream(stream(keys[e], scans[e]), m)
            for path in range(draws.shape[2]):
                draws[e, m, path] = uniform(stream(own, path), 1)


@kernel
def receive_targets(
    key, scan, pair, targets, scene, factors, reference, reach, rate_floor, offsets, times, speed, law, outputs
):  # fmt: skip
    """Add the echoes of targets (target, 6) over the visible paths to outputs (pulse, element, 2, delay).

    factors (target x slot): SNR of each path in this scan over its mean. reference: eta at 100 m. offsets, times: see
    ``path_delays``; law: see ``add_echoes``, without its last argument. In each scan each path has a new phase, and a
    new range-rate about that of its target (standard deviation rate_floor).
    """
    own, slots, count = stream(stream(key, scan), pair), scene.path_index.shape[3], 0
    most = len(targets) * slots
    states, images, numbers = np.empty((most, 6)), np.empty((most, 6)), np.empty(most, np.int64)
    for g in range(len(targets)):
        for w in range(scene.path_count[pair, scan, g]):
            states[count], numbers[count] = targets[g], g * slots + w
            images[count] = scene.images[pair, scene.path_index[pair, scan, g, w]]
            count += 1
    delays, amplitudes = np.empty((count, len(times), len(offsets))), np.zeros(count, np.complex128)
    path_delays(
        states[:count], images[:count, :2], images[:count, 2:4], images[:count, 4:], offsets, times, speed, delays
    )
    for i in range(count):
        r = 0.5 * speed * delays[i].mean()
        if r > reach:
            continue
        g, w = divmod(numbers[i], slots)
        shift = 2.0 / speed * rate_floor * normal(stream(own, numbers[i]), 2)
        for q in range(len(times)):
            delays[i, q] += shift * times[q]
        eta = factors[numbers[i]] * snr_at(r, reference, scene.reflected[pair, scan, g, w])
        phase = 2.0 * np.pi * uniform(stream(own, numbers[i]), 0)
        amplitudes[i] = np.sqrt(0.5 * eta) * complex(np.cos(phase), np.sin(phase))
    add_echoes(delays, amplitudes, law[0], law[1], law[2], law[3], outputs)


@kernel
def receive_noise(key, scan, pair, waveform, frames, law, outputs):
    """Add the noise of a scan, minus the mean noise of the recorded background, to outputs (pulse, element, 2, delay).

    The background of a world has one mean for each waveform and pair, over all pulses of ``frames`` trains. law: see
    ``receiver.NoiseLaw``.
    """
    own = stream(stream(stream(key, scan), pair), NOISE)
    recorded = stream(stream(stream(key, BACKGROUND), waveform), pair)
    add_noise(own, recorded, 1.0 / np.sqrt(frames * len(outputs)), law.rank, law.factors, law.second, outputs)


@inlined
def snr_of_peak(snr, mean):
    """eta at which C / eta is the covariance of the errors of a peak; ``mean``: mean eta of a Rayleigh echo.

    The peak has the power snr / 2 + 1 of echo and noise, and the search over delay, Doppler and direction has added 3/2
    (half a chi-square variable of three degrees of freedom). With m = mean / 2 and k = m / (m + 1), the amplitude given
    the peak is complex normal: its mean has k^2 of the power, its variance is k. The mean of 1 / S is about that of one
    over their difference. So noise that has raised a weak echo above the threshold does not make it look precise.
    """
    m = 0.5 * mean
    k = m / (m + 1.0)
    return max(2.0 * (k * k * (0.5 * snr - 0.5) - k), CELL)


@kernel
def report(z, R, snr, reference, steady, out, out_R):
    """Write measurements to out (most, m) and their covariances to out_R (most, m, m); return their number.

    z (peak, 3), R (peak, 3, 3) and snr (peak,) belong to the peaks. The mean SNR of an echo is that of a direct path of
    its range. steady: whether every echo has it.
    """
    count, size = min(len(z), len(out)), out.shape[1]
    for i in range(count):
        mean = snr_at(z[i, 0], reference, 1.0)
        wider = snr[i] / (mean if steady else snr_of_peak(snr[i], mean))
        for j in range(size):
            out[i, j] = z[i, j]
            for k in range(size):
                out_R[i, j, k] = wider * R[i, j, k]
    return count


@inlined
def rows_of(e, x, P):
    """x (s M, n) and P (s M, n, n) of environment e, as ``combine_one`` takes them."""
    rows, n = x.shape[1] * x.shape[2], x.shape[3]
    return x[e].reshape(rows, n), P[e].reshape(rows, n, n)


@kernel
def costs(x, P, mu, existence, weights, absent, out, nn, mm):
    """Fill out (e, s) with the cost of every slot, in ascending order; ``absent``: cost of an absent track."""
    slots, n = mu.shape[1], len(nn)
    mean, covariance = np.empty((slots, n)), np.empty((slots, n, n))
    for e in range(len(out)):
        own_x, own_P = rows_of(e, x, P)
        for s in range(slots):
            combine_one(s, own_x, own_P, mu[e], mean, covariance, nn, mm)
            trace = 0.0
            for k in range(n):
                trace += covariance[s, k, k] * weights[k]
            out[e, s] = absent - existence[e, s] * (absent - min(trace, absent))
        out[e].sort()


@inlined
def distance_one(e, t, s, targets, mean):
    """Distance of target t from the mean of track s, m."""
    return math.hypot(targets[e, t, 0] - mean[s, 0], targets[e, t, 1] - mean[s, 1])


@inlined
def nearest_one(e, t, targets, sure, mean):
    """Distance of target t from the nearest confirmed track, and its slot; infinite if no track is confirmed."""
    least, near = np.inf, 0
    for s in range(sure.shape[1]):
        distance = distance_one(e, t, s, targets, mean) if sure[e, s] else np.inf
        if distance < least:
            least, near = distance, s
    return least, near


@inlined
def is_false(e, s, targets, present, mean, within):
    """Whether no target is near track s."""
    alone = True
    for t in range(targets.shape[1]):
        alone = alone and not (present[e, t] and distance_one(e, t, s, targets, mean) <= within)
    return alone


@kernel
def squared_error(e, t, s, targets, mean, covariance, off):
    """NEES of position and velocity of target t by track s; off (4,): scratch space."""
    for k in range(4):
        off[k] = targets[e, t, k] - mean[s, k]
    solved, total = np.linalg.solve(covariance[s, :4, :4].copy(), off), 0.0
    for k in range(4):
        total += off[k] * solved[k]
    return total


@kernel
def figures(step, x, P, mu, status, targets, present, number, within, values, held, counts, sure, places, nn, mm):
    """Fill the figures of targets, the counts of a scan, the flags of confirmed tracks and their places.

    targets (e, t, n), present (e, t), number (e, pair): the truth. within: greatest distance at which a track holds a
    target, m. values (3, e, t): position error, position variance and NEES; held (e, t); counts (4, e): confirmed,
    false and tentative tracks, measurements; sure (e, s); places (e, s, 2): x and y of confirmed tracks, otherwise 0.
    """
    slots, n = mu.shape[1], len(nn)
    mean, covariance, off = np.empty((slots, n)), np.empty((slots, n, n)), np.empty(4)
    places[:], counts[:] = 0.0, 0
    for e in range(len(step)):
        own_x, own_P = rows_of(e, x, P)
        for s in range(slots):
            sure[e, s] = status[e, s] == CONFIRMED
            counts[2, e] += status[e, s] != EMPTY and not sure[e, s]
            if sure[e, s]:
                combine_one(s, own_x, own_P, mu[e], mean, covariance, nn, mm)
                places[e, s, 0], places[e, s, 1] = mean[s, 0], mean[s, 1]
                counts[0, e] += 1
                counts[1, e] += is_false(e, s, targets, present, mean, within)
        counts[3, e] = number[e].sum()
        for t in range(targets.shape[1]):
            least, near = nearest_one(e, t, targets, sure, mean)
            held[e, t] = present[e, t] and least <= within
            values[0, e, t], values[1, e, t], values[2, e, t] = min(least, within) if present[e, t] else 0.0, 0.0, 0.0
            if held[e, t]:
                values[1, e, t] = covariance[near, 0, 0] + covariance[near, 1, 1]
                values[2, e, t] = squared_error(e, t, near, targets, mean, covariance, off)
