"""Piecewise Legendre expansions: spectral sampling, differentiation, quadrature and Fourier integrals of a pulse.

A pulse is smooth on a few intervals (``Waveform.pieces``) and may have kinks between them. Each interval is cut into
equal panels. In each panel a function is represented by its values at Gauss-Legendre nodes. Panels are halved until the
last coefficients vanish: the error is a rounding error for any pulse, also with kinks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError

ComplexArray = NDArray[np.complex128]

NODES = 32
_FIRST_PANELS = 4
_MOST_PANELS = 8192  # over all intervals; at least _FEWEST_LIMIT in each
_FEWEST_LIMIT = 64
_TAIL = 4  # last coefficients checked; several, since a symmetric function has zeros in every other one
_RESOLVED = 1e-14
_NEARLY_RESOLVED = 1e-8

_X, _W = legendre.leggauss(NODES)
_ORDERS = np.arange(NODES)
_VALUES_TO_COEFFICIENTS = (_W[:, None] * legendre.legvander(_X, NODES - 1)) * (_ORDERS + 0.5)  # (node, order)
_SLOPES = np.stack([legendre.legval(_X, legendre.legder(row)) for row in np.eye(NODES)])  # (order, node)
_DERIVATIVE = _VALUES_TO_COEFFICIENTS @ _SLOPES  # (node, node)

# Integrates a polynomial of degree < 32 times exp(-j z x) to rounding for every |z| <= 32.
_FINE_X, _FINE_W = legendre.leggauss(2 * NODES)
_FINE_POLYNOMIALS = _FINE_W[:, None] * legendre.legvander(_FINE_X, NODES - 1)  # (fine node, order)


@dataclass(frozen=True)
class Expansion:
    """A vector function sampled on the panels of several intervals.

    Attributes:
        centres: panel centres, (interval, panel).
        half: half the width of an interval's panels, (interval,).
        values: the function at the nodes, (component, interval, panel, node).
    """

    centres: FloatArray
    half: FloatArray
    values: NDArray

    @property
    def times(self) -> FloatArray:
        """Node positions, (interval, panel, node)."""
        return _nodes(self.centres, self.half)

    @property
    def weights(self) -> FloatArray:
        """Quadrature weight of each node, (interval, 1, node); sums over the panels by broadcasting."""
        return self.half[:, None, None] * _W

    def derivative(self) -> NDArray:
        """The function's time derivative at the nodes, (component, interval, panel, node)."""
        return (self.values @ _DERIVATIVE) / self.half[:, None, None]

    def fourier(self, omega: FloatArray) -> ComplexArray:
        """Integral of f(t) exp(-j omega t) over all intervals, (component, omega); omega in rad per unit of t.

        Filon's rule integrates each panel's Legendre expansion times the exponential exactly. The number of panels
        depends on f alone, not on omega.
        """
        moments = legendre_moments(omega * self.half[:, None])  # (interval, order, omega)
        per_panel = ((self.values @ _VALUES_TO_COEFFICIENTS) * self.half[:, None, None]) @ moments
        return (per_panel * np.exp(-1j * self.centres[..., None] * omega)).sum(axis=(1, 2))


def resolve(
    function: Callable[[FloatArray], NDArray], low: FloatArray, high: FloatArray, floor: FloatArray, name: str
) -> Expansion:
    """Sample ``function`` on the intervals [low, high]; panels are halved until the samples determine it to rounding.

    Args:
        function: times (interval, panel, node) -> values (component, interval, panel, node), real or complex.
        low, high: ends of the intervals, (interval,).
        floor: per component, (component,): errors of 1e-14 of this, or of the component's peak, are accepted.
        name: name of the function in an error.

    Raises:
        InputError: a function with a jump or a kink inside an interval, or one that is not finite.
    """
    panels, previous = _FIRST_PANELS, np.inf
    while True:
        half = (high - low) / (2 * panels)
        centres = low[:, None] + half[:, None] * (2 * np.arange(panels) + 1)
        values = function(_nodes(centres, half))
        scale = np.maximum(floor, np.abs(values).max(axis=(1, 2, 3)))
        tails = np.abs(values @ _VALUES_TO_COEFFICIENTS[:, -_TAIL:]).max(axis=(1, 2, 3))
        tail = float((tails / scale).max())
        # A phase of 1e5 rad or a time far from the origin carries rounding noise that more panels cannot remove.
        only_noise = tail <= _NEARLY_RESOLVED and tail > previous / 4
        if tail <= _RESOLVED or only_noise:
            return Expansion(centres, half, values)
        if panels >= max(_FEWEST_LIMIT, _MOST_PANELS // len(low)) or not np.isfinite(tail):
            raise InputError(
                f"{name} is not smooth, expected finite values with kinks or jumps only at the ends of its `pieces`"
            )
        panels, previous = 2 * panels, tail


def legendre_moments(z: FloatArray) -> ComplexArray:
    """Integral over [-1, 1] of P_n(x) exp(-j z x) = 2 (-j)^n j_n(z) for n < 32; z (interval, k) -> (interval, n, k)."""
    flat = np.abs(z).ravel()
    bessel = np.empty((NODES, flat.size))  # 2 j_n(|z|)
    small = flat <= NODES
    phases = np.exp(-1j * flat[small, None] * _FINE_X)
    integrals = (phases @ _FINE_POLYNOMIALS).T  # (n, k)
    turn = (1j**_ORDERS)[:, None]
    bessel[:, small] = (integrals * turn).real
    large = flat[~small]  # upward recurrence is stable where n < z
    if large.size:
        before, now = 2 * np.cos(large) / large, 2 * np.sin(large) / large  # orders -1 and 0
        rows = []
        for order in range(NODES):
            rows.append(now)
            before, now = now, (2 * order + 1) / large * now - before
        bessel[:, ~small] = rows
    moments = bessel * turn.conj()  # (-j)^n
    moments[1::2] *= np.sign(z).ravel()
    return moments.reshape(NODES, *z.shape).swapaxes(0, 1)


def _nodes(centres: FloatArray, half: FloatArray) -> FloatArray:
    return centres[..., None] + half[:, None, None] * _X
