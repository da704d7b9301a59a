"""The ratio of variances that a filter in double precision can use."""

from __future__ import annotations

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError

MOST_RATIO = 1e12
"""Greatest ratio of a predicted variance to a measurement variance: an update loses ratio times 1e-16 of P."""


def check_precision(P: Array, C: Array, eta: Array, reference_range: float) -> None:
    """Raise an InputError for pulses so much finer than the first prediction that an update loses all digits.

    Args:
        P: first predicted covariance of range and range-rate, (..., 2, 2).
        C: measurement covariances of all waveforms at unit SNR, (waveform, 2, 2).
        eta: SNR at the first range, (...).
        reference_range: the range at which eta = 1, m. The error names its nearest valid value.
    """
    P, power = np.asarray(P)[..., None, :, :], np.asarray(eta)[..., None]
    det = C[:, 0, 0] * C[:, 1, 1] - C[:, 0, 1] * C[:, 1, 0]
    with np.errstate(all="ignore"):
        weighted = C[:, 1, 1] * P[..., 0, 0] - 2.0 * C[:, 0, 1] * P[..., 0, 1] + C[:, 0, 0] * P[..., 1, 1]
        # trace(R^-1 P) is at least the greatest ratio; a C that is singular up to rounding has no inverse at all.
        ratio = float(np.where(det > 0.0, power * weighted / det, np.inf).max())
    if not ratio <= MOST_RATIO:
        nearest = reference_range * (MOST_RATIO / ratio) ** 0.25
        hint = f"(nearest: {nearest:.3g} m; or " if nearest > 0.0 else "("
        raise InputError(
            f"reference_range is {reference_range!r} m: the first predicted variance is up to {ratio:.3g} times a "
            f"pulse's, expected at most {MOST_RATIO:g}, the limit of double precision {hint}a smaller dt, q, "
            "prior_variance or carrier_hz, or less extreme durations and sweeps)"
        )
