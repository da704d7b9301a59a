"""Kernels of ``receiver.py``: echoes at the elements of an array, and the peaks of the delay-Doppler image."""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import normal
from wavegym.core.kernels import kernel

STEERINGS = 32  # directions tried for each peak


@kernel
def path_delays(states, out, back, axes, offsets, times, speed, delays):
    """Delay of each path at each pulse and element, (path, pulse, element) in s.

    states (path, 6): target in the middle of the train, constant acceleration; out, back (path, 2): images of
    transmitter and array; axes (path, 2): axis of the array in that image; offsets (element,): positions of the
    elements along the axis, m; times (pulse,): s from the middle of the train.
    """
    for w in range(len(states)):
        for q in range(len(times)):
            t = times[q]
            x = states[w, 0] + t * (states[w, 2] + 0.5 * t * states[w, 4])
            y = states[w, 1] + t * (states[w, 3] + 0.5 * t * states[w, 5])
            there = np.hypot(x - out[w, 0], y - out[w, 1])
            for m in range(len(offsets)):
                a = x - back[w, 0] - offsets[m] * axes[w, 0]
                b = y - back[w, 1] - offsets[m] * axes[w, 1]
                delays[w, q, m] = (there + np.hypot(a, b)) / speed


@kernel
def add_echoes(delays, amplitudes, carrier, spacing, spectra):
    """Add exp(-j 2 pi (fc + f) tau) of each path to spectra (pulse, element, frequency), ``spacing`` Hz apart, in FFT
    order. All elements share the envelope delay of the array centre: they are half a wavelength apart.
    """
    paths, pulses, elements = delays.shape
    length = spectra.shape[2]
    phasors = np.empty(elements, np.complex128)
    for q in range(pulses):
        for w in range(paths):
            for m in range(elements):
                phasors[m] = amplitudes[w] * np.exp(-2j * np.pi * carrier * delays[w, q, m])
            turn = np.exp(-2j * np.pi * spacing * delays[w, q].mean())
            ramp = 1.0 + 0.0j
            for m in range(elements):
                spectra[q, m, 0] += phasors[m]
            for k in range(1, length // 2 + 1):
                ramp *= turn
                for m in range(elements):
                    if 2 * k < length:
                        spectra[q, m, k] += phasors[m] * ramp
                    spectra[q, m, length - k] += phasors[m] * np.conj(ramp)


@kernel
def add_noise(key, scale, samples):
    """Add circular white noise of variance ``scale`` squared to samples (sample,)."""
    part = scale * np.sqrt(0.5)
    for i in range(len(samples)):
        samples[i] += part * complex(normal(key, 2 * i), normal(key, 2 * i + 1))


@kernel
def brightest(cube, steering, power):
    """power (delay, Doppler) of cube (element, delay, Doppler) in the strongest beam of steering (beam, element)."""
    elements, delays, dopplers = cube.shape
    power[:] = 0.0
    for b in range(len(steering)):
        for d in range(delays):
            for f in range(dopplers):
                total = 0.0j
                for m in range(elements):
                    total += steering[b, m] * cube[m, d, f]
                power[d, f] = max(power[d, f], total.real * total.real + total.imag * total.imag)


@kernel
def find_maxima(power, threshold, found):
    """Write the cells of local maxima above the threshold to found (most, 2); return their number.

    The first and last delay are left out; Doppler is periodic. Only the ``most`` strongest maxima are kept.
    """
    delays, dopplers = power.shape
    count = 0
    for d in range(1, delays - 1):
        for f in range(dopplers):
            here = power[d, f]
            if here < threshold or not _is_maximum(power, d, f):
                continue
            if count < len(found):
                count += 1
                i = count - 1
            elif here > power[found[count - 1, 0], found[count - 1, 1]]:
                i = count - 1
            else:
                continue
            while i > 0 and here > power[found[i - 1, 0], found[i - 1, 1]]:
                found[i] = found[i - 1]
                i -= 1
            found[i, 0], found[i, 1] = d, f
    return count


@kernel
def _is_maximum(power, d, f):
    last = power.shape[1]
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            other = power[d + i, (f + j) % last]
            if other > power[d, f] or (other == power[d, f] and (i, j) < (0, 0)):
                return False
    return True


@kernel
def drop_sidelobes(power, found, count, delay_decay, pulses, oversampled, margin):
    """Keep the maxima that exceed the lobes of all stronger maxima; return how many are kept. Strongest first.

    The main lobe is Gaussian in delay, exp(-delay_decay cells^2), and one resolution cell (``oversampled`` cells) wide
    in Doppler. Beyond it, a train of B = ``pulses`` has Doppler sidelobes 1 / (B sin(pi x / B))^2, x in resolution
    cells, relative to the power at the same delay and the Doppler of the stronger maximum.
    """
    kept = 0
    for i in range(count):
        d, f = found[i]
        reached = 0.0
        for k in range(kept):
            x = abs(f - found[k, 1])
            x = min(x, power.shape[1] - x) / oversampled
            if x < 1.0:
                reached += power[found[k, 0], found[k, 1]] * np.exp(-delay_decay * (d - found[k, 0]) ** 2)
            else:
                reached += power[d, found[k, 1]] / (pulses * np.sin(np.pi * x / pulses)) ** 2
        if power[d, f] > margin * reached:
            found[kept, 0], found[kept, 1] = d, f
            kept += 1
    return kept


@kernel
def fit_peaks(cube, found, count, solve, own, peaks):
    """Fit log|A|^2 = a - (x - x0)^T C (x - x0) about each maximum, in cells.

    peaks (peak, 8) = x0, C00, C01, C11, eta, the spatial frequency of the direction in cycles per element, and the
    power that one plane wave leaves at the elements, relative to that of noise: more if two paths share the cell.

    solve (6, 9) maps the nine log powers, in the direction of greatest power, to the coefficients of
    1, d, f, d^2, df, f^2. A fit without a maximum within a cell is replaced by the centre of the cell and by ``own``
    (C00, C01, C11), the curvature of the waveform.
    """
    for i in range(count):
        d, f = found[i]
        u = _direction(cube, d, f)
        logs = np.empty(9)
        for k in range(9):
            logs[k] = np.log(_steered(cube, d + k // 3 - 1, (f + k % 3 - 1) % cube.shape[2], u))
        c = solve @ logs
        C00, C01, C11 = -c[3], -0.5 * c[4], -c[5]
        det = C00 * C11 - C01 * C01
        x = 0.5 * (C11 * c[1] - C01 * c[2]) / det
        y = 0.5 * (C00 * c[2] - C01 * c[1]) / det
        top = c[0] + 0.5 * (c[1] * x + c[2] * y)
        if not (C00 > 0.0 and det > 0.0 and abs(x) <= 1.0 and abs(y) <= 1.0):
            x, y, top = 0.0, 0.0, logs[4]
            C00, C01, C11 = own
        peaks[i, 0], peaks[i, 1] = d + x, f + y
        peaks[i, 2], peaks[i, 3], peaks[i, 4] = C00, C01, C11
        peaks[i, 5], peaks[i, 6] = 2.0 * max(np.exp(top) - 1.0, 0.5), u
        peaks[i, 7] = _rest(cube, d, f, u)


@kernel
def _steered(cube, d, f, u):
    """Power of a cell in the direction of spatial frequency u, cycles per element."""
    total = 0.0j
    for m in range(len(cube)):
        total += cube[m, d, f] * np.exp(2j * np.pi * u * m)
    return total.real * total.real + total.imag * total.imag


@kernel
def _rest(cube, d, f, u):
    """Power of a cell that a plane wave of spatial frequency u leaves, over its mean in noise; 1 for one element.

    Noise has the power 1 / L at each of L elements. Of L complex numbers the wave explains one, and u half a number.
    """
    elements = len(cube)
    if elements == 1:
        return 1.0
    total = 0.0
    for m in range(elements):
        total += cube[m, d, f].real ** 2 + cube[m, d, f].imag ** 2
    return (total - _steered(cube, d, f, u) / elements) * elements / (elements - 1.5)


@kernel
def _direction(cube, d, f):
    """Spatial frequency of greatest power: the best of a grid, and the vertex of a parabola through its neighbours."""
    best, direction = -1.0, 0.0
    for k in range(STEERINGS):
        power = _steered(cube, d, f, k / STEERINGS)
        if power > best:
            best, direction = power, k / STEERINGS
    before, after = (
        _steered(cube, d, f, direction - 1.0 / STEERINGS),
        _steered(cube, d, f, direction + 1.0 / STEERINGS),
    )
    bend = 2.0 * best - before - after
    return direction + (0.5 * (after - before) / bend / STEERINGS if bend > 0.0 else 0.0)
