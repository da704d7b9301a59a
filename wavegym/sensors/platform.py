"""An RF/EO platform: its measurements, and its resolution and field of view by pulses and pixels.

The field of view is a penalty on the measurement variance, in smooth and in sharp forms.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import Array, check_broadcast, check_elements, check_finite
from wavegym.core.errors import InputError, check_choice, check_int, check_non_negative, check_positive
from wavegym.sensors import platform_kernels as kernels

Penalty = Literal["logistic", "hard", "deadzone", "huber", "log-barrier"]
PENALTIES: tuple[str, ...] = get_args(Penalty)
KINDS = {
    "logistic": kernels.LOGISTIC,
    "hard": kernels.HARD,
    "deadzone": kernels.DEADZONE,
    "huber": kernels.HUBER,
    "log-barrier": kernels.LOG_BARRIER,
}
SHARPNESS = {"logistic": 100.0, "hard": 100.0, "deadzone": 100.0, "huber": 100.0, "log-barrier": 1e8}


def platform_measurement(state: ArrayLike, platform: ArrayLike, as_printed: bool = False) -> Array:
    """c(x) = (r, rdot, azimuth): eqs. (4) and (5) of O'Rourke and Swindlehurst, and the azimuth that follows them.

    Args:
        state: x = [x xdot y ydot] in m and m/s, (..., 4).
        platform: (x, y, look direction) in m, m and rad, (..., 3); the look direction is clockwise from +y. Leading
            axes broadcast with those of ``state``.
        as_printed: use the paper's formulas. The second term of its range-rate has the wrong sign. Its arcsin(dx / r)
            does not distinguish a target behind the platform from one in front.

    Returns:
        (r in m, rdot in m/s, azimuth in rad from the look direction, wrapped to [-pi, pi]), (..., 3). rdot is positive
        when the target recedes; azimuth = atan2(dx, dy) - look. r is at least 1e-9 m; at the platform itself rdot is 0.

    Raises:
        InputError: shapes that do not fit, or numbers that are not finite.
    """
    return kernels.measure(check_finite("state", state, 4), check_finite("platform", platform, 3), float(as_printed))


def platform_jacobian(state: ArrayLike, platform: ArrayLike, as_printed: bool = False) -> Array:
    """C = dc/dx of ``platform_measurement``, (..., 3, 4): rows r, rdot, azimuth; columns x, xdot, y, ydot.

    The arguments are those of ``platform_measurement``.
    """
    return kernels.jacobian(check_finite("state", state, 4), check_finite("platform", platform, 3), float(as_printed))


class View(NamedTuple):
    """Variance and field of view of (range, range-rate, azimuth from the look direction), in m, m/s and rad."""

    variance: Array  # (..., 3) of a target in the field of view
    low: Array  # (..., 3) lower edges; -inf for the range
    high: Array  # (..., 3) upper edges; an azimuth image of the full circle has -inf and inf


def platform_view(
    prf: ArrayLike,
    bandwidth: ArrayLike,
    pixel_angle: ArrayLike,
    wavelength: float,
    fft_length: int,
    pixels: int,
    as_printed: bool = False,
) -> View:
    """Variances and field of view of (range, range-rate, azimuth).

    Errors are uniform in a resolution cell: c / 2B, lambda PRF / (2 Nfft), one pixel (O'Rourke and Swindlehurst,
    section V). The field of view holds the unambiguous ranges and range-rates and the image: r <= c / (2 PRF),
    |rdot| <= lambda PRF / 4 and |azimuth| <= Npix alpha / 2 (eq. 15). An image of the full circle has no edge.

    Args:
        prf: pulse repetition frequency in Hz, (...).
        bandwidth: B of a pulse in Hz, (...).
        pixel_angle: alpha, the angle of a pixel in rad, (...).
        wavelength: lambda in m.
        fft_length: Nfft, number of integrated pulses.
        pixels: Npix, number of pixels of the one-dimensional image.
        as_printed: use r <= lambda PRF / 2 (in m) and 0 <= rdot <= c / (2 PRF) (in m/s). Eqs. (14a) and (14b) swap the
            two bounds, have a wrong factor, and bound rdot on one side only.

    Raises:
        InputError: a value that is not > 0, or shapes that do not fit.
    """
    given = {"prf": prf, "bandwidth": bandwidth, "pixel_angle": pixel_angle}
    checked = {name: check_elements(check_positive, name, values) for name, values in given.items()}
    settings = np.stack(check_broadcast(**checked), axis=-1)
    check_positive("wavelength", wavelength, "m")
    lengths = check_int("fft_length", fft_length, 1), check_int("pixels", pixels, 1)
    return View(*kernels.view(settings, wavelength, *lengths, float(as_printed)))


def fov_penalty(
    kind: str, x: ArrayLike, low: ArrayLike, high: ArrayLike, sharpness: ArrayLike, height: ArrayLike
) -> Array:
    """phi(x, [low, high]): the increase of a measured quantity's variance near and outside the field of view.

    With nu = sharpness / high and gamma = height:

    * ``"logistic"`` gamma [expit(2 nu (x - high)) + expit(2 nu (low - x))]: eq. (13) of O'Rourke and Swindlehurst on
      both sides. gamma / 2 at the edge; less than p times the variance v only for
      |x| <= high (1 - ln(gamma / (p v)) / (2 sharpness)).
    * ``"hard"`` gamma outside, exactly 0 inside.
    * ``"deadzone"`` gamma nu times the distance outside, exactly 0 inside: gamma at high / sharpness beyond the edge.
    * ``"huber"`` the same with a round corner: gamma (nu d)^2 / 2 up to the distance d = 1 / nu outside, then
      gamma (nu d - 1/2). It has a gradient everywhere.
    * ``"log-barrier"`` -(gamma / sharpness) ln(1 - (x / high)^2), at most gamma; gamma outside. It is 0 at the centre
      only: choose a sharpness much greater than gamma over the variance.

    Args:
        kind: one of the above.
        x: the measured quantity, (...).
        low, high: the interval in the unit of x, high > 0, (...). low may be -inf; high = inf means no penalty at all.
        sharpness: relative to ``high``, (...).
        height: gamma, in the unit of x squared, (...).

    Returns:
        phi in the unit of x squared, (...).

    Raises:
        InputError: an unknown kind, or an invalid shape or value.
    """
    code = KINDS[check_choice("penalty", kind, PENALTIES)]
    check_elements(check_positive, "sharpness", sharpness)
    check_elements(check_positive, "high edge of the field of view", np.minimum(high, np.finfo(float).max))
    check_elements(check_non_negative, "height", height)
    if np.isnan(x).any():
        raise InputError("x is nan, expected numbers")
    lower, upper = check_broadcast(low=low, high=high)
    if not (lower < upper).all():
        raise InputError(f"field of view has the edges {low!r} and {high!r}, expected low < high")
    return kernels.penalty(code, x, low, high, sharpness, height)
