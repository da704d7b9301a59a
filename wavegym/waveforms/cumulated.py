"""Cumulated moments of a pulse: integrals up to any time, tabulated, from which those over any receive gate follow.

A table is made once for a shape of pulse, in units of x = t / T and of w / W: all Gaussian chirps share one table, all
trapezoid chirps of one law another. Time scale T (s) and rate scale W (rad/s) belong to the waveform (``scales``).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError
from wavegym.waveforms.chirp_laws import CHIRP_LAWS
from wavegym.waveforms.gaussian import GaussianChirp
from wavegym.waveforms.numeric import numeric_fisher_factors, sample
from wavegym.waveforms.trapezoid import TrapezoidChirp
from wavegym.waveforms.waveform import Waveform

CELLS = 256
"""Cells of a table. In a cell a polynomial of degree 5 interpolates."""
COLUMNS = 8
"""Integrals of a^2, x a^2, x^2 a^2, h a^2, x h a^2, h^2 a^2 and a'^2, and a^2 itself."""

_LEAST_CELLS = 8  # of a piece
_FINE = 512  # steps of a piece, to place the cells
_GAUSSIAN_HALF = 6.1  # durations; 6e-18 of the energy lies beyond
_TWO_PI = 2.0 * np.pi

_NODES = 16
_X, _W = legendre.leggauss(_NODES)
_TO_COEFFICIENTS = (_W[:, None] * legendre.legvander(_X, _NODES - 1)) * (np.arange(_NODES) + 0.5)  # (node, order)
_INNER = np.sqrt((7.0 + 2.0 * np.sqrt(7.0) * np.array([1.0, -1.0])) / 21.0)
_POINTS = np.array([-1.0, -_INNER[0], -_INNER[1], _INNER[1], _INNER[0], 1.0])  # Lobatto: both ends of a cell included
_INTEGRALS = np.stack([legendre.legval(_POINTS, legendre.legint(row, lbnd=-1)) for row in np.eye(_NODES)])
_TO_INTEGRALS = _TO_COEFFICIENTS @ _INTEGRALS  # (node, point): from the cell's begin to the point
_TO_VALUES = _TO_COEFFICIENTS @ legendre.legvander(_POINTS, _NODES - 1).T  # (node, point)
_TO_MONOMIALS = np.linalg.inv(np.vander(0.5 * (_POINTS + 1.0), increasing=True)).T  # (point, power) of s in [0, 1]

Sampler = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]


class CumulatedMoments(NamedTuple):
    """A table of the cumulated moments of a pulse of one shape, centred in time, in units of T and W.

    h is the residual of the regression of w on x over the whole pulse: exactly 0 for linear FM. So a long chirp loses
    no digits.
    """

    nodes: FloatArray  # (cell + 1,) ends of the cells, x from the energy's centre
    left: FloatArray  # (cell, column, power) of s in [0, 1]: integrals up to x
    right: FloatArray  # (cell, column, power): integrals from x on
    total: FloatArray  # (column,) over the whole pulse; the first is the energy, 1
    centre: float  # the energy's centre, x
    slope: float  # slope of the regression of w/W on x
    density: float  # greatest a^2


def cumulated_moments(waveform: Waveform) -> CumulatedMoments:
    """The table of a single pulse; cached for Gaussian and trapezoid chirps, by quadrature for any other waveform.

    Raises:
        InputError: a waveform that ``numeric_fisher_information`` refuses, or one with more than 32 pieces.
    """
    if isinstance(waveform, GaussianChirp):
        return _gaussian()
    if isinstance(waveform, TrapezoidChirp):
        return _trapezoid(waveform.kind, waveform.law.shape, waveform.law.rise_fraction)
    return _numeric(waveform)


def scales(waveform: Waveform) -> tuple[float, float]:
    """T (s) and W (rad/s) of a single pulse: k and 2 d g k, lam and 2 pi d D, else 1 s and 1 rad/s."""
    if isinstance(waveform, GaussianChirp):
        return waveform.duration, 2.0 * waveform.signed_chirp_rate * waveform.duration
    if isinstance(waveform, TrapezoidChirp):
        return waveform.duration, _TWO_PI * waveform.signed_sweep
    return 1.0, 1.0


@lru_cache(maxsize=1)
def _gaussian() -> CumulatedMoments:
    def both(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        a = np.exp(-0.5 * (x * x)) / np.pi**0.25
        return a, -x * a, np.zeros_like(x)

    return _table(both, np.array([[-_GAUSSIAN_HALF, _GAUSSIAN_HALF]]), linear=1.0)


@lru_cache(maxsize=256)
def _trapezoid(kind: str, shape: float, rise: float) -> CumulatedMoments:
    frequency = CHIRP_LAWS.get(kind).frequency
    height = 1.0 / np.sqrt(1.0 - 4.0 * rise / 3.0)

    def both(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        left, right = (0.5 + x) / rise, (0.5 - x) / rise
        ramp = np.minimum(np.minimum(left, right), 1.0)
        sign = np.where(left < 1.0, np.where(left <= right, 1.0, -1.0), np.where(right < 1.0, -1.0, 0.0))
        u = x + 0.5
        return height * ramp, height * sign / rise, frequency(u, shape) - u  # the bend: exactly 0 for linear FM

    edges = np.array([-0.5, rise - 0.5, 0.5 - rise, 0.5])
    pieces = np.stack([edges[:-1], edges[1:]], axis=-1)
    return _table(both, pieces[pieces[:, 0] < pieces[:, 1]], linear=1.0)


def _numeric(waveform: Waveform) -> CumulatedMoments:
    slope = float(np.asarray(numeric_fisher_factors(waveform).slope))  # checks the waveform
    samples = sample(waveform)
    functions = np.stack([samples.values[0], *samples.derivative()])  # (function, interval, panel, node)
    pieces = np.array(waveform.pieces, dtype=np.float64)

    def both(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        a, rate, w = _evaluate(functions, samples.centres, samples.half, pieces, x)
        return a, rate, w - slope * x

    return _table(both, pieces, linear=slope)


def _evaluate(
    functions: FloatArray, centres: FloatArray, half: FloatArray, pieces: FloatArray, x: FloatArray
) -> FloatArray:
    """The panels' polynomials at x, (function, *x.shape); 0 between two pieces."""
    nodes, weights = legendre.leggauss(functions.shape[-1])
    order = np.arange(len(nodes))
    coefficients = functions @ ((weights[:, None] * legendre.legvander(nodes, len(nodes) - 1)) * (order + 0.5))
    flat = x.ravel()
    piece = np.clip(np.searchsorted(pieces[:, 0], flat, side="right") - 1, 0, len(pieces) - 1)
    panel = np.clip(((flat - pieces[piece, 0]) / (2.0 * half[piece])).astype(int), 0, centres.shape[1] - 1)
    local = (flat - centres[piece, panel]) / half[piece]
    values = (coefficients[:, piece, panel] * legendre.legvander(local, len(nodes) - 1)).sum(axis=-1)
    return np.where(flat <= pieces[piece, 1], values, 0.0).reshape(len(functions), *x.shape)


def _table(both: Sampler, pieces: FloatArray, linear: float) -> CumulatedMoments:
    """Table of a pulse with envelope a, its rate, and w less ``linear`` x, all three at x; smooth on ``pieces``."""
    nodes = _cells(both, pieces)
    half = 0.5 * np.diff(nodes)
    x = (nodes[:-1] + half)[:, None] + half[:, None] * _X  # (cell, node)
    a, rate, bend = both(x)
    density = a * a
    weights = half[:, None] * _W
    energy = (density * weights).sum()
    weighted = density * weights / energy
    centre = (x * weighted).sum()
    time = x - centre
    bend = bend - (bend * weighted).sum()
    excess = (time * bend * weighted).sum() / (time * time * weighted).sum()
    h = bend - excess * time
    integrands = np.stack([a * a, time * a * a, time * time * a * a, h * a * a, time * h * a * a, h * h * a * a])
    integrands = np.concatenate([integrands, (rate * rate)[None]]) / energy  # (column, cell, node)
    inside = (integrands @ _TO_INTEGRALS) * half[:, None]  # (column, cell, point)
    whole = inside[..., -1:]
    before = np.cumsum(whole, axis=1) - whole
    after = np.cumsum(whole[:, ::-1], axis=1)[:, ::-1] - whole
    edge = (density / energy) @ _TO_VALUES  # (cell, point)
    left, right = (
        np.ascontiguousarray((np.concatenate([part, edge[None]]) @ _TO_MONOMIALS).transpose(1, 0, 2))
        for part in (before + inside, after + (whole - inside))
    )
    return CumulatedMoments(
        nodes=nodes - centre,
        left=left,
        right=right,
        total=np.append(whole.sum(axis=(1, 2)), 0.0),
        centre=float(centre),
        slope=float(linear + excess),
        density=float(edge.max()),
    )


def _cells(both: Sampler, pieces: FloatArray) -> FloatArray:
    """Ends of the cells, (CELLS + 1,), dense where the amplitude is large; kinks between pieces are ends of cells."""
    edges = np.unique(pieces)
    if (len(edges) - 1) * _LEAST_CELLS > CELLS:
        raise InputError(f"the pulse has {len(pieces)} pieces, expected at most {CELLS // _LEAST_CELLS} smooth pieces")
    steps = (np.arange(_FINE) + 0.5) / _FINE
    x = edges[:-1, None] + np.diff(edges)[:, None] * steps
    widths = np.diff(edges)[:, None] / _FINE
    wanted = np.sqrt(np.abs(both(x)[0])) * widths
    wanted = 0.75 * wanted / wanted.sum() + 0.25 * widths / (_FINE * widths.sum())
    shares = 0.5 * wanted.sum(axis=1) + 0.5 / len(x)
    ends = np.rint(np.cumsum(shares) * CELLS).astype(int)
    counts = np.diff(np.concatenate([[0], ends]))
    parts = []
    for i, count in enumerate(counts):
        reached = np.concatenate([[0.0], np.cumsum(wanted[i])])
        at = np.interp(np.arange(count) / count, reached / reached[-1], np.linspace(edges[i], edges[i + 1], _FINE + 1))
        parts.append(at)
    return np.concatenate([*parts, edges[-1:]])
