"""Resolution and field of view of an RF/EO platform, from its pulses and pixels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.array_checks import check_broadcast, check_elements
from wavegym.core.arrays import Array
from wavegym.core.errors import check_int, check_positive
from wavegym.sensors import platform_kernels as kernels


class View(NamedTuple):
    """What settings are worth, of (range, range-rate, azimuth from the look direction), in m, m/s and rad."""

    variance: Array  # (..., 3) of what is in the field of view
    low: Array  # (..., 3) its lower edges; of the range -inf
    high: Array  # (..., 3) and upper ones; of the azimuth -inf and inf where the image is the full circle


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
    section V). In view is what is unambiguous and on the image: r <= c / (2 PRF), |rdot| <= lambda PRF / 4 and
    |azimuth| <= Npix alpha / 2 (eq. 15); an image of the full circle has no edge.

    Args:
        prf: pulse repetition frequency in Hz, (...).
        bandwidth: B of a pulse in Hz, (...).
        pixel_angle: alpha, the angle that a pixel subtends, rad, (...).
        wavelength: lambda in m.
        fft_length: Nfft, pulses integrated.
        pixels: Npix, of the one-dimensional image.
        as_printed: r <= lambda PRF / 2 (in m) and 0 <= rdot <= c / (2 PRF) (in m/s): eqs. (14a) and (14b) have the two
            swapped, a factor wrong and the second one-sided.

    Raises:
        InputError: anything that is not > 0, shapes that do not fit.
    """
    values = {"prf": prf, "bandwidth": bandwidth, "pixel_angle": pixel_angle}
    settings = np.stack(
        check_broadcast(**{name: check_elements(check_positive, name, value) for name, value in values.items()}),
        axis=-1,
    )
    check_positive("wavelength", wavelength, "m")
    lengths = check_int("fft_length", fft_length, 1), check_int("pixels", pixels, 1)
    return View(*kernels.view(settings, wavelength, *lengths, float(as_printed)))
