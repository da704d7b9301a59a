"""Kernels of the urban loop at the signal level: echoes and noise of a scan, and covariances of raised peaks."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.core.kernels import kernel
from wavegym.sensors.geometry_kernels import snr_at
from wavegym.sensors.receiver_kernels import add_echoes, add_noise, path_delays

NOISE = 20_000  # number of the noise stream of a scan, beyond those of all paths
BACKGROUND = 30_000  # number of the stream of the recorded background, beyond those of all scans


@kernel
def fluctuation_draws(keys, scans, draws):
    """Uniform draws of the SNR of each path in scan ``scans[e]`` of environment e, (env, pair, target x slot)."""
    for e in range(len(keys)):
        for m in range(draws.shape[1]):
            own = stream(stream(keys[e], scans[e]), m)
            for path in range(draws.shape[2]):
                draws[e, m, path] = uniform(stream(own, path), 1)


@kernel
def receive_targets(key, scan, pair, targets, scene, factors, reference, reach, offsets, times, speed, law, outputs):
    """Add the echoes of targets (target, 6) over the visible paths to outputs (pulse, element, 2, delay).

    factors (target x slot): SNR of each path in this scan over its mean. reference: eta at 100 m. offsets, times: see
    ``path_delays``; law: see ``add_echoes``, without its last argument. Phases are new in every scan, for every path.
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
        eta = factors[numbers[i]] * snr_at(r, reference, scene.reflected[pair, scan, g, w])
        phase = 2.0 * np.pi * uniform(stream(own, numbers[i]), 0)
        amplitudes[i] = np.sqrt(0.5 * eta) * complex(np.cos(phase), np.sin(phase))
    add_echoes(delays, amplitudes, law[0], law[1], law[2], law[3], outputs)


@kernel
def receive_noise(key, scan, pair, waveform, frames, law, outputs):
    """Add noise of a scan, less the mean noise of the recorded background, to outputs (pulse, element, 2, delay).

    The background of a world has one mean over all pulses of ``frames`` trains for each waveform and pair. law: see
    ``receiver.NoiseLaw``.
    """
    own = stream(stream(stream(key, scan), pair), NOISE)
    recorded = stream(stream(stream(key, BACKGROUND), waveform), pair)
    add_noise(own, recorded, 1.0 / np.sqrt(frames * len(outputs)), law.rank, law.factors, law.second, outputs)


@kernel
def report(z, R, snr, reference, out, out_R):
    """Write measurements to out (most, m) and their covariances to out_R (most, m, m); return their number.

    z (peak, 3), R (peak, 3, 3) and snr (peak,) are those of peaks. A peak that is higher than that of a direct path of
    its range has the covariance at the SNR of that path: noise has raised it, and of the echoes near the threshold only
    those that noise raises are detected.
    """
    count, size = min(len(z), len(out)), out.shape[1]
    for i in range(count):
        raised = max(snr[i] / snr_at(z[i, 0], reference, 1.0), 1.0)
        for j in range(size):
            out[i, j] = z[i, j]
            for k in range(size):
                out_R[i, j, k] = raised * R[i, j, k]
    return count
