"""Compiled eclipsing: pulses cut by a closed receiver; ``eclipsing.py`` has the public functions.

Shapes of pulses are tables of cumulated moments (``wavegym/waveforms/cumulated.py``): nodes (table, cell + 1), left and
right (table, cell, column, power), total (table, column), constants (table, 3): centre, slope and greatest density. All
times of a pulse are in units of its time scale. ``Tables`` and ``Pulses`` of ``eclipsing.py`` hold them; each is one
argument of a kernel.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.waveforms.fisher import SPEED_OF_LIGHT

LEAST_SHARE = 1e-6
"""Visible share of the energy below which a pulse is invisible."""
LEAST_RESIDUAL = 1e-12
"""Least delay information, relative to the whole pulse's: a flat stretch of linear FM alone has none."""
TWO_PI = 2.0 * np.pi
HALF_C = 0.5 * SPEED_OF_LIGHT


@inlined
def cell_of(nodes, k, x):
    """The cell of table k that contains x, by bisection."""
    low, high = 0, nodes.shape[1] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if nodes[k, middle] <= x:
            low = middle
        else:
            high = middle
    return low


@inlined
def polynomial(p, s):
    """The polynomial with the coefficients p (6,) at s."""
    return p[0] + s * (p[1] + s * (p[2] + s * (p[3] + s * (p[4] + s * p[5]))))


@inlined
def part(nodes, c, k, x):
    """All columns of table k at x, 8 numbers: integrals up to x (c = ``left``) or from x (``right``), and a^2 at x."""
    cell = cell_of(nodes, k, x)
    s = (x - nodes[k, cell]) / (nodes[k, cell + 1] - nodes[k, cell])
    p = c[k, cell]
    return (
        polynomial(p[0], s), polynomial(p[1], s), polynomial(p[2], s), polynomial(p[3], s),
        polynomial(p[4], s), polynomial(p[5], s), polynomial(p[6], s), polynomial(p[7], s),
    )  # fmt: skip


@inlined
def plus(m, n, sign):
    """m + sign n, element by element; the last element of m stays."""
    return (
        m[0] + sign * n[0], m[1] + sign * n[1], m[2] + sign * n[2], m[3] + sign * n[3],
        m[4] + sign * n[4], m[5] + sign * n[5], m[6] + sign * n[6], m[7],
    )  # fmt: skip


@inlined
def whole(tables, k):
    """The integrals over the whole pulse; a^2 at its ends is 0."""
    m = tables.total[k]
    return m[0], m[1], m[2], m[3], m[4], m[5], m[6], 0.0


@kernel
def window(tables, k, low, high):
    """The integrals over low <= x <= high, 7 numbers, and a^2 at the end minus a^2 at the beginning."""
    nodes = tables.nodes
    begins, ends = nodes[k, 0], nodes[k, nodes.shape[1] - 1]
    if high <= begins or low >= ends or high <= low:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if low <= begins and high < ends:
        return part(nodes, tables.left, k, high)
    if low > begins and high >= ends:
        m = part(nodes, tables.right, k, low)
        return m[0], m[1], m[2], m[3], m[4], m[5], m[6], -m[7]
    m = whole(tables, k)
    if low <= begins:
        return m
    before, after = part(nodes, tables.left, k, low), part(nodes, tables.right, k, high)
    m = plus(plus(m, before, -1.0), after, -1.0)
    return m[0], m[1], m[2], m[3], m[4], m[5], m[6], after[7] - before[7]


@inlined
def reduced(tables, k, m):
    """(share, spread, slope, residual, bandwidth) of gated moments m, in units of T and W; what is left has SNR 1.

    m[7] is a^2 at the ends of the gates minus a^2 at their beginnings. Re <s', s> is half of it. The projection on the
    gated pulse subtracts its square from the envelope's bandwidth.
    """
    share = m[0]
    if not share >= LEAST_SHARE:
        share, m = 0.0, whole(tables, k)
    one = 1.0 / m[0]
    time, h = m[1] * one, m[3] * one
    # The energy cannot be narrower than at the greatest density, also after rounding.
    narrowest = m[0] / tables.constants[k, 2]
    spread = max(m[2] * one - time * time, narrowest * narrowest / 12.0)
    coupling = m[4] * one - time * h
    residual = max(m[5] * one - h * h - coupling * coupling / spread, 0.0)
    bandwidth = max((m[6] - 0.25 * m[7] * m[7] * one) * one, 0.0)
    return min(share, 1.0), spread, tables.constants[k, 1] + coupling / spread, residual, bandwidth


@kernel
def gated(tables, k, delay, first, last, recovery, interval):
    """``reduced`` of an echo that arrives ``delay`` after its pulse, all times in units of T.

    first, last: transmitted interval, in the pulse's own time. The receiver is open from last + recovery until
    interval + first, in every interval; with interval = inf, until the end.
    """
    centre = tables.constants[k, 0]
    opens, closes = last + recovery - delay - centre, first - delay - centre  # of pulse 0, in x
    if np.isinf(interval):
        return reduced(tables, k, window(tables, k, opens, np.inf))
    ends = tables.nodes[k, tables.nodes.shape[1] - 1]
    n = np.floor((tables.nodes[k, 0] - closes) / interval)
    m = window(tables, k, opens + n * interval, closes + (n + 1.0) * interval)
    n += 1.0
    while opens + n * interval < ends:
        more = window(tables, k, opens + n * interval, closes + (n + 1.0) * interval)
        m = plus(m, more, 1.0)
        m = (m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7] + more[7])
        n += 1.0
    return reduced(tables, k, m)


@kernel
def gated_factors(tables, k, time_scale, rate_scale, delay, first, last, recovery, interval, count):
    """(share, residual, slope, spread), s and rad/s: visible share of the energy, ``FisherFactors`` of what is left.

    For pulses with continuous parameters: T and W, the delay (s), the transmitted interval (s), recovery and interval
    (s; inf for one pulse) and the number of pulses of a coherent train.
    """
    t = 1.0 / time_scale
    share, spread, slope, residual, bandwidth = gated(
        tables, k, delay * t, first * t, last * t, recovery * t, interval * t
    )
    whole = tables.total[k, 6] + (rate_scale * rate_scale) * tables.total[k, 5] * (time_scale * time_scale)
    own = bandwidth + (rate_scale * rate_scale) * residual * (time_scale * time_scale)
    r = max(own, LEAST_RESIDUAL * whole) * (t * t)
    b, v = rate_scale * slope * t, spread * (time_scale * time_scale)
    if count > 1.0:
        dwell = interval * interval * (count * count - 1.0) / 12.0
        v_train = v + dwell
        r, b, v = r + b * b * (v * dwell / v_train), b * (v / v_train), v_train
    return share, r, b, v


@kernel
def eclipsed_factors(tables, pulses, w, delay):
    """``gated_factors`` of pulse w of ``pulses`` for an echo that arrives ``delay`` (s) after its pulse."""
    p = pulses.timing[w]
    return gated_factors(tables, pulses.table[w], p[0], p[1], delay, p[2], p[3], p[4], p[5], p[6])


@kernel
def covariance_of(share, r, b, v, carrier):
    """(R00, R01, R11) of (range, range-rate) at unit *transmitted* SNR; an invisible pulse counts as LEAST_SHARE."""
    rate = HALF_C / (TWO_PI * carrier)
    one = 1.0 / max(share, LEAST_SHARE)
    delay = HALF_C / r
    return HALF_C * delay * one, -rate * (delay * b) * one, rate * rate * (1.0 / v + b * b / r) * one


@kernel
def eclipsed_covariance(tables, pulses, w, range_m, carrier):
    """(share, R00, R01, R11) of pulse w for a target at ``range_m``, at unit transmitted SNR."""
    share, r, b, v = eclipsed_factors(tables, pulses, w, range_m / HALF_C)
    R00, R01, R11 = covariance_of(share, r, b, v, carrier)
    return share, R00, R01, R11


@inlined
def is_whole(window, w, delay):
    """Whether the receiver sees the whole echo of pulse w, ``delay`` (s) after the pulse; ``window`` (w, 10).

    A row of ``window``: the first delay with a whole echo, the length of that time (inf: for ever), then the row of the
    tables and the pulse's ``timing``. Times repeat with the interval.
    """
    late = delay - window[w, 0]
    return late >= 0.0 and (late <= window[w, 1] or late % window[w, 8] <= window[w, 1])


@kernel
def windowed_covariance(tables, window, w, range_m, carrier):
    """``eclipsed_covariance`` of the pulse in row w of ``window``."""
    share, r, b, v = gated_factors(
        tables, np.int64(window[w, 2]), window[w, 3], window[w, 4], range_m / HALF_C, window[w, 5], window[w, 6],
        window[w, 7], window[w, 8], window[w, 9]
    )  # fmt: skip
    R00, R01, R11 = covariance_of(share, r, b, v, carrier)
    return share, R00, R01, R11


@kernel
def factors(tables, pulses, waveform, range_m, out):
    """eclipsed_factors, element by element: out (e, 4)."""
    for e in range(len(out)):
        out[e, 0], out[e, 1], out[e, 2], out[e, 3] = eclipsed_factors(tables, pulses, waveform[e], range_m[e] / HALF_C)


@kernel
def covariances(tables, pulses, waveform, range_m, carrier, R):
    """eclipsed_covariance, element by element: R (e, 2, 2)."""
    for e in range(len(R)):
        _, R00, R01, R11 = eclipsed_covariance(tables, pulses, waveform[e], range_m[e], carrier[e])
        R[e, 0, 0], R[e, 0, 1], R[e, 1, 0], R[e, 1, 1] = R00, R01, R01, R11
