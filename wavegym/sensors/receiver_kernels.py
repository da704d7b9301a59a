"""Kernels of ``receiver.py``: outputs of matched filters at the elements of an array, Doppler, peaks of the image.

Complex numbers are two rows, real and imaginary parts, with delay cells along the last axis, so that compilers
vectorise the loops. Outputs are (pulse, element, 2, delay), images (Doppler, element, 2, delay).
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import cosines_and_sines, fill_normals
from wavegym.core.kernels import inlined, kernel
from wavegym.sensors.geometry_kernels import direction_variance

SPARE = 2  # spare cells of the table of responses before the earliest cell that an echo needs


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
def add_echoes(delays, amplitudes, carrier, rate, latest, table, outputs):
    """Add the echo of each path to outputs (pulse, element, 2, delay): amplitude x response(cell - rate x delay).

    table (phase + 3, 1 or 2, lag) holds the real part of the response of the matched filter to a pulse, and its
    imaginary part if there is one. Its rows are even fractions of a cell, from one before 0 to one beyond 1. Column l
    is at l - delays of outputs - ``SPARE`` cells. Between rows the response is a cubic polynomial through four rows.
    All elements have the envelope delay of the array centre, because they are half a wavelength apart.

    delays (path, pulse, element), s; a path with a delay beyond ``latest`` is not received; ``rate``: cells per second.
    """
    paths, pulses, elements = delays.shape
    cells = outputs.shape[3]
    phases, response = len(table) - 3, np.empty(cells)
    turns, cosines, sines = np.empty(pulses * elements), np.empty(pulses * elements), np.empty(pulses * elements)
    for w in range(paths):
        if delays[w].max() > latest:
            continue
        for q in range(pulses):
            for k in range(elements):
                turn = -carrier * delays[w, q, k]
                turns[q * elements + k] = turn - np.rint(turn)
        cosines_and_sines(turns, cosines, sines)
        for q in range(pulses):
            place = -phases * rate * delays[w, q].mean()
            step = int(np.floor(place))
            cell, phase = divmod(step, phases)
            for part in range(table.shape[1]):
                _interpolate(table, phase, part, cell + cells + SPARE, place - step, response)
                for m in range(elements):
                    phasor = amplitudes[w] * complex(cosines[q * elements + m], sines[q * elements + m])
                    real, imag = (phasor.real, phasor.imag) if part == 0 else (-phasor.imag, phasor.real)
                    re, im = outputs[q, m, 0], outputs[q, m, 1]
                    for d in range(cells):
                        re[d] += real * response[d]
                        im[d] += imag * response[d]


@kernel
def _interpolate(table, phase, part, start, x, out):
    """Value at x of Lagrange's polynomial through four rows of the table, from ``phase`` on, at -1, 0, 1 and 2."""
    before, here = table[phase, part, start : start + len(out)], table[phase + 1, part, start : start + len(out)]
    next_one, last = table[phase + 2, part, start : start + len(out)], table[phase + 3, part, start : start + len(out)]
    a, b, c, d = x + 1.0, x, x - 1.0, x - 2.0
    w0, w1, w2, w3 = -b * c * d / 6.0, 0.5 * a * c * d, -0.5 * a * b * d, a * b * c / 6.0
    for i in range(len(out)):
        out[i] = (w0 * before[i] + w1 * here[i]) + (w2 * next_one[i] + w3 * last[i])


@kernel
def add_noise(key, mean_key, mean_scale, rank, factors, second, outputs):
    """Add the noise of a train to outputs (pulse, element, 2, delay), minus the noise of a mean over many trains.

    Normals times factors are the real and imaginary parts of a and b, each with half as many cells. The noise is
    a + i b in the first cells and a - i b, reversed, in the last. factors, ``rank`` and ``second``: see
    ``receiver.NoiseLaw``. The mean is drawn from ``mean_key`` and is the same at all pulses; ``mean_scale`` is the
    ratio of its standard deviation to that of a pulse. Blocks of pulses stay in the cache.
    """
    pulses, elements, _, _ = outputs.shape
    rows = 2 * elements  # rows of normals of a pulse; those of two pulses are a multiple of four
    mean, weights = np.zeros((rows, rank)), np.empty((2 * rows, rank))
    if mean_scale > 0.0:
        fill_normals(mean_key, 0, mean.reshape(-1))
    one, other = np.empty((2 * rows, factors[0].shape[1])), np.empty((2 * rows, factors[1].shape[1]))
    for q in range(0, pulses, 2):
        fill_normals(key, q * rows * rank, weights.reshape(-1))
        for k in range(2):
            for i in range(rows):
                row, own = weights[k * rows + i], mean[i]
                for j in range(rank):
                    row[j] -= mean_scale * own[j]
        multiply(weights, 0, factors[0], one)
        multiply(weights, second, factors[1], other)
        for i in range(min(2, pulses - q) * elements):
            _join(one[2 * i : 2 * i + 2], other[2 * i : 2 * i + 2], outputs[q + i // elements, i % elements])


@kernel
def _join(a, b, output):
    """Add the two halves of the noise to output (2, delay)."""
    cells = output.shape[1]
    half = cells // 2
    ar, ai, br, bi, re, im = a[0], a[1], b[0], b[1], output[0], output[1]
    for d in range(half):
        re[d] += ar[d] - bi[d]
        im[d] += ai[d] + br[d]
        re[cells - 1 - d] += ar[d] + bi[d]
        im[cells - 1 - d] += ai[d] - br[d]
    if cells % 2:
        re[half] += ar[half]
        im[half] += ai[half]


@kernel
def multiply(a, first, b, out):
    """out (n, m) = a[:, first : first + k] @ b (k, m); n and k are multiples of four.

    Without a library every processor gives the same last bits, and small products start no threads.
    """
    for i in range(0, len(out), 4):
        out[i : i + 4] = 0.0
        for k in range(0, len(b), 4):
            _add_product(a[i : i + 4, first + k : first + k + 4], b[k : k + 4], out[i : i + 4])


@inlined
def _add_product(a, b, out):
    """out (4, m) += a (4, 4) @ b (4, m): one pass over the memory for sixteen products."""
    a00, a01, a02, a03 = a[0, 0], a[0, 1], a[0, 2], a[0, 3]
    a10, a11, a12, a13 = a[1, 0], a[1, 1], a[1, 2], a[1, 3]
    a20, a21, a22, a23 = a[2, 0], a[2, 1], a[2, 2], a[2, 3]
    a30, a31, a32, a33 = a[3, 0], a[3, 1], a[3, 2], a[3, 3]
    o0, o1, o2, o3 = out[0], out[1], out[2], out[3]
    b0, b1, b2, b3 = b[0], b[1], b[2], b[3]
    for j in range(len(b0)):
        x0, x1, x2, x3 = b0[j], b1[j], b2[j], b3[j]
        o0[j] += (a00 * x0 + a01 * x1) + (a02 * x2 + a03 * x3)
        o1[j] += (a10 * x0 + a11 * x1) + (a12 * x2 + a13 * x3)
        o2[j] += (a20 * x0 + a21 * x1) + (a22 * x2 + a23 * x3)
        o3[j] += (a30 * x0 + a31 * x1) + (a32 * x2 + a33 * x3)


@kernel
def transform(outputs, waves, image):
    """Doppler transform of outputs (pulse, element, 2, delay) to image (Doppler, element, 2, delay).

    X[f] = sum over q of x[c + q] exp(-2 pi i f q / D), with pulse c in the middle. D is a multiple of four, so f = 0 to
    D / 4 give all of X: X[f] and X[-f] share the cosine sum of x[c + q] + x[c - q] and the sine sum of
    -i (x[c + q] - x[c - q]); in X[D/2 - f] the terms of odd q change their signs. waves: see ``ArrayReceiver._waves``.
    """
    dopplers, elements, cells = len(image), outputs.shape[1], outputs.shape[3]
    terms, sums = np.zeros((4, waves.shape[2], 2 * cells)), np.empty((4, 4, 2 * cells))
    for m in range(elements):
        for kind in range(4):
            _fold(outputs, m, kind, terms[kind])
        for f in range(dopplers // 4 + 1):
            if f % 4 == 0:
                for kind in range(4):
                    multiply(waves[kind, f : f + 4], 0, terms[kind], sums[kind])
            _butterfly(sums[0, f % 4], sums[1, f % 4], sums[2, f % 4], sums[3, f % 4], f, m, image)


@kernel
def _butterfly(even, odd, even_sine, odd_sine, f, m, image):
    """The four Doppler cells of ``transform`` that share the sums at f, at element m."""
    dopplers, columns = len(image), len(even)
    up, down = image[f, m].reshape(columns), image[(dopplers - f) % dopplers, m].reshape(columns)
    after, before = image[dopplers // 2 + f, m].reshape(columns), image[dopplers // 2 - f, m].reshape(columns)
    for j in range(columns):
        p, s = even[j] + odd[j], even_sine[j] + odd_sine[j]
        q, t = even[j] - odd[j], even_sine[j] - odd_sine[j]
        up[j], down[j], after[j], before[j] = p + s, p - s, q + t, q - t


@kernel
def _fold(outputs, m, kind, terms):
    """Terms (q, part and delay) of the sums of ``transform`` at element m.

    kind 0: x[c + q] + x[c - q] for even q; 1: the same for odd q; 2 and 3: -i (x[c + q] - x[c - q]).
    """
    pulses, _, _, cells = outputs.shape
    middle = pulses // 2
    for k in range(kind % 2, middle + 1, 2):
        for part in range(2):
            row = terms[k // 2, part * cells : (part + 1) * cells]
            other, sign = (part, 1.0) if kind < 2 else (1 - part, 2.0 * part - 1.0)  # -i (a + i b) = b - i a
            before = outputs[middle - k, m, other]
            for d in range(cells):
                row[d] = sign * before[d]
            if k == 0:
                row *= 0.0 if kind >= 2 else 1.0
            elif middle + k < pulses:
                after, way = outputs[middle + k, m, other], 1.0 if kind < 2 else -sign
                for d in range(cells):
                    row[d] += way * after[d]


@kernel
def find_peaks(image, threshold, beams, directions, solve, own, pulses, margin, found, peaks):
    """Peaks of an image (Doppler, element, 2, delay) above the threshold; return their number. See ``fit_peaks``.

    Fills found (most, 2) and peaks (most, 8). For the other arguments see ``drop_sidelobes`` and ``fit_peaks``.
    """
    power = np.empty((image.shape[0], image.shape[3]))
    brightest(image, threshold, beams, power)
    count = find_maxima(power, threshold, found)
    count = drop_sidelobes(image, power, beams, found, count, own[0], pulses, margin)
    fit_peaks(image, found, count, solve, directions, own, peaks)
    return count


@kernel
def brightest(image, threshold, beams, power):
    """power (Doppler, delay) of image (Doppler, element, 2, delay) in the strongest beam; 0 below the threshold.

    No beam has more power than the number of elements times the sum of their powers. So most cells need no beam.
    """
    dopplers, elements, _, delays = image.shape
    total = np.empty(delays)
    for f in range(dopplers):
        total[:] = 0.0
        for m in range(elements):
            re, im = image[f, m, 0], image[f, m, 1]
            for d in range(delays):
                total[d] += re[d] * re[d] + im[d] * im[d]
        row = power[f]
        for d in range(delays):
            row[d] = _strongest(image, d, f, beams) if elements * total[d] >= threshold else 0.0


@kernel
def _strongest(image, d, f, beams):
    """Power of a cell in the strongest of beams (beam, element)."""
    best = 0.0
    for b in range(len(beams)):
        best = max(best, _steered(image, d, f, beams[b]))
    return best


@inlined
def _steered(image, d, f, beam):
    """Power of a cell in the direction of beam (element,)."""
    real = imag = 0.0
    for m in range(len(beam)):
        a, b, c, s = image[f, m, 0, d], image[f, m, 1, d], beam[m].real, beam[m].imag
        real += a * c - b * s
        imag += a * s + b * c
    return real * real + imag * imag


@kernel
def find_maxima(power, threshold, found):
    """Write (delay, Doppler) of local maxima of power (Doppler, delay) above the threshold to found (most, 2).

    Returns their number. The first and the last delay are excluded; Doppler is periodic. Only the ``most`` strongest
    maxima are kept, in order of strength.
    """
    dopplers, delays = power.shape
    count = 0
    for f in range(dopplers):
        for d in range(1, delays - 1):
            here = power[f, d]
            if here < threshold or not _is_maximum(power, d, f):
                continue
            if count < len(found):
                count += 1
                i = count - 1
            elif here > power[found[count - 1, 1], found[count - 1, 0]]:
                i = count - 1
            else:
                continue
            while i > 0 and here > power[found[i - 1, 1], found[i - 1, 0]]:
                found[i] = found[i - 1]
                i -= 1
            found[i, 0], found[i, 1] = d, f
    return count


@kernel
def _is_maximum(power, d, f):
    last = len(power)
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            other = power[(f + j) % last, d + i]
            if other > power[f, d] or (other == power[f, d] and (i, j) < (0, 0)):
                return False
    return True


@kernel
def drop_sidelobes(image, power, beams, found, count, delay_decay, pulses, margin):
    """Keep the maxima that exceed the lobes of all stronger maxima, strongest first; returns how many are kept.

    The main lobe is Gaussian in delay, exp(-delay_decay cells^2), and one resolution cell wide in Doppler. Beyond it, a
    train of B = ``pulses`` has Doppler sidelobes 1 / (B sin(pi x / B))^2, x in resolution cells, relative to the power
    at the same delay and the Doppler of the stronger maximum.
    """
    kept, dopplers = 0, len(power)
    for i in range(count):
        d, f = found[i]
        reached = 0.0
        for k in range(kept):
            x = abs(f - found[k, 1])
            x = min(x, dopplers - x) * (pulses / dopplers)
            if x < 1.0:
                reached += power[found[k, 1], found[k, 0]] * np.exp(-delay_decay * (d - found[k, 0]) ** 2)
            else:
                reached += _strongest(image, d, found[k, 1], beams) / (pulses * np.sin(np.pi * x / pulses)) ** 2
        if power[f, d] > margin * reached:
            found[kept, 0], found[kept, 1] = d, f
            kept += 1
    return kept


@kernel
def fit_peaks(image, found, count, solve, directions, own, peaks):
    """Fit log|A|^2 = a - (x - x0)^T C (x - x0) about each maximum, in cells.

    peaks (peak, 8) = x0, C00, C01, C11, eta, the spatial frequency of the direction in cycles per element, and the
    power that one plane wave does not explain, relative to that of noise. It is larger if two paths share the cell.

    solve (6, 9) maps the nine log powers, in the direction of greatest power, to the coefficients of 1, d, f, d^2, df,
    f^2. If a fit has no maximum within a cell, the centre of the cell and ``own`` (C00, C01, C11), the curvature of the
    waveform, replace it. directions (direction, element): the beams that are tried first.
    """
    beam, logs, c = np.empty(image.shape[1], np.complex128), np.empty(9), np.empty(6)
    for i in range(count):
        d, f = found[i]
        u = _direction(image, d, f, directions)
        for m in range(len(beam)):
            beam[m] = np.exp(2j * np.pi * u * m)
        for k in range(9):
            logs[k] = np.log(_steered(image, d + k // 3 - 1, (f + k % 3 - 1) % len(image), beam))
        for k in range(6):
            c[k] = (solve[k] * logs).sum()
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
        peaks[i, 7] = _rest(image, d, f, beam)


@kernel
def _rest(image, d, f, beam):
    """Power of a cell that a plane wave does not explain, divided by its mean in noise; 1 for one element.

    Noise has the power 1 / L at each of L elements. The wave explains one of L complex numbers, and its direction
    another half.
    """
    elements = len(beam)
    if elements == 1:
        return 1.0
    total = 0.0
    for m in range(elements):
        total += image[f, m, 0, d] ** 2 + image[f, m, 1, d] ** 2
    return (total - _steered(image, d, f, beam) / elements) * elements / (elements - 1.5)


@kernel
def _direction(image, d, f, directions):
    """Spatial frequency of greatest power: vertex of a parabola through the best direction and its neighbours."""
    count, best, at = len(directions), -1.0, 0
    for k in range(count):
        power = _steered(image, d, f, directions[k])
        if power > best:
            best, at = power, k
    before = _steered(image, d, f, directions[(at - 1) % count])
    after = _steered(image, d, f, directions[(at + 1) % count])
    bend = 2.0 * best - before - after
    return (at + (0.5 * (after - before) / bend if bend > 0.0 else 0.0)) / count


@kernel
def measurements(peaks, cells, dopplers, elements, z, R, snr):
    """Convert peaks (peak, 8) of ``fit_peaks`` to z (peak, 3), R (peak, 3, 3) and snr (peak,): see ``receiver.Peaks``.

    cells: size of a cell in range and range-rate, m and m/s.
    """
    R[:] = 0.0
    for i in range(len(peaks)):
        x, y, C00, C01, C11, eta, u, rest = peaks[i]
        turns = y / dopplers
        z[i, 0], z[i, 1] = x * cells[0], cells[1] * dopplers * (turns - np.rint(turns))
        z[i, 2] = -2.0 * (u - np.rint(u))  # the phase decreases along the beam by half a cycle per element
        scale = 1.0 / ((C00 * C11 - C01 * C01) * eta)
        R[i, 0, 0], R[i, 1, 1] = cells[0] ** 2 * C11 * scale, cells[1] ** 2 * C00 * scale
        R[i, 0, 1] = R[i, 1, 0] = -cells[0] * cells[1] * C01 * scale
        R[i, 2, 2] = max(rest, 1.0) * direction_variance(eta, elements)
        snr[i] = eta
