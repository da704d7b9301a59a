"""Smoothing splines of one target's reports, and the choice of their time constant from the reports themselves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import eigh, solveh_banded

from wavegym.core.arrays import FloatArray

FEWEST = 5  # reports of a stretch that is smoothed
# Time constants that are tried, in mean times between reports, up to a sixth of a block.
FACTORS = (0.0, *(2.0 ** (k / 2) for k in range(-4, 7)))
BLOCK = 48  # reports of a stretch that are tried together
MOST_BLOCKS = 8  # of a track, spread over its whole length
NEGLIGIBLE = 1e-3  # m
ENDS = 2  # reports at either end of a block that do not count: their prediction is an extrapolation


def smoothed(times: FloatArray, positions: FloatArray, tau: float) -> FloatArray:
    """Positions (report, 3) that minimise Σ|report - curve|² + (τ⁴/h)∫|curve''|² dt, h the mean time between reports.

    The minimum is a natural cubic spline through the positions returned. Its second derivatives γ at the inner reports
    solve (R + λ QᵀQ) γ = Qᵀ y with λ = τ⁴/h (Green and Silverman 1994, section 2.3.3): five diagonals, so the effort is
    linear in the reports.

    Args:
        times: ascending [s], (report,), at least 3.
        positions: metres, (report, 3).
        tau: time constant [s], > 0.
    """
    h = np.diff(times)
    weight = tau**4 / h.mean()
    second = np.diff(np.diff(positions, axis=0) / h[:, None], axis=0)  # Qᵀ y
    before, after = 1.0 / h[:-1], 1.0 / h[1:]
    middle = -(before + after)
    bands = np.zeros((3, len(middle)))  # upper diagonals as LAPACK takes them, the main diagonal last
    bands[2] = (h[:-1] + h[1:]) / 3.0 + weight * (before**2 + middle**2 + after**2)
    bands[1, 1:] = h[1:-1] / 6.0 + weight * (middle[:-1] * before[1:] + after[:-1] * middle[1:])
    bands[0, 2:] = weight * after[:-2] * before[2:]
    bend = solveh_banded(bands, second)
    shift = np.zeros_like(positions)  # Q γ
    shift[:-2] += before[:, None] * bend
    shift[1:-1] += middle[:, None] * bend
    shift[2:] += after[:, None] * bend
    return positions - weight * shift


def choose_factor(stretches: Sequence[tuple[FloatArray, FloatArray]]) -> float:
    """The time constant, in mean times between reports, that predicts left-out reports best; 0 for few reports.

    Each report is left out in turn and predicted by the smoothing spline of the others. Independent errors of the
    reports are predicted better by a longer time constant, manoeuvres by a shorter one. The least mean squared error of
    prediction decides between ``FACTORS``.

    Args:
        stretches: times (report,) [s] and positions (report, 3) [m] of each stretch without a gap.
    """
    errors = [errors_of_prediction(*block) for block in _blocks(stretches)]
    if not errors:
        return 0.0
    squares = np.concatenate(errors, axis=1).mean(axis=1)
    return FACTORS[int((squares <= squares.min() + NEGLIGIBLE**2).argmax())]  # of equal errors the least smoothing


def errors_of_prediction(times: FloatArray, positions: FloatArray) -> FloatArray:
    """Squared distance of each inner report from its prediction by the others, (factor, report - 2 ENDS), m².

    A report's error of prediction is its residual over one minus its leverage. Residuals are A y, and one minus the
    leverages are the diagonal of A = Q (R/λ + QᵀQ)⁻¹ Qᵀ. The generalised eigenvectors of QᵀQ and R make A diagonal for
    all λ at once. Without smoothing both vanish alike; the factor R/λ is then R.
    """
    h = np.diff(times)
    h = h / h.mean()
    inner = np.arange(len(h) - 1)
    Q = np.zeros((len(times), len(inner)))
    Q[inner, inner], Q[inner + 2, inner] = 1.0 / h[:-1], 1.0 / h[1:]
    Q[inner + 1, inner] = -Q[inner, inner] - Q[inner + 2, inner]
    R = np.diag((h[:-1] + h[1:]) / 3.0)
    R[inner[:-1], inner[1:]] = R[inner[1:], inner[:-1]] = h[1:-1] / 6.0
    values, vectors = eigh(Q.T @ Q, R)
    basis = Q @ vectors  # (report, inner)
    gain = 1.0 / (1.0 + np.multiply.outer(np.array(FACTORS) ** 4, values))  # (factor, inner)
    residual = np.einsum("ij,fj,jk->fik", basis, gain, basis.T @ positions, optimize=True)
    leverage = gain @ np.square(basis).T
    error = residual / leverage[:, :, None]
    return np.square(error).sum(axis=2)[:, ENDS:-ENDS]


def _blocks(stretches: Sequence[tuple[FloatArray, FloatArray]]) -> list[tuple[FloatArray, FloatArray]]:
    """Blocks of up to ``BLOCK`` successive reports; of many blocks a few, evenly spread."""
    blocks = []
    for times, positions in stretches:
        count = max(1, len(times) // BLOCK)
        parts = zip(np.array_split(times, count), np.array_split(positions, count), strict=True)
        blocks += [part for part in parts if len(part[0]) >= FEWEST + 2 * ENDS]
    if len(blocks) > MOST_BLOCKS:
        blocks = [blocks[i] for i in np.linspace(0, len(blocks) - 1, MOST_BLOCKS).round().astype(int)]
    return blocks
