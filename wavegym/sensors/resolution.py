"""Resolution and field of view of an RF/EO platform as functions of its pulses and pixels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_broadcast, check_elements
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int, check_positive
from wavegym.sensors import platform_kernels as kernels


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
