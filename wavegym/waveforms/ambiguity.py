"""Ambiguity function and its cuts, for any waveform.

chi(tau, nu) = int s(t) s*(t - tau) exp(-j 2 pi nu t) dt, so chi(0, 0) = 1 and the ridge of an up-chirp has positive
slope in the (delay, Doppler) plane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.array_checks import check_finite
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError
from wavegym.waveforms.waveform import Waveform

ComplexArray = NDArray[np.complex128]


def ambiguity(waveform: Waveform, delays: ArrayLike, dopplers: ArrayLike) -> ComplexArray:
    """Two-sided ambiguity function chi on a grid, complex, (delay, doppler); absolute error about 1e-13.

    Each delay is integrated to rounding error, for any spacing of the grid. Beyond the result, the memory does not grow
    with the grid.

    Args:
        waveform: any waveform.
        delays: tau, s, (delay,) or a number.
        dopplers: nu, Hz, (doppler,) or a number.

    Raises:
        InputError: delays or dopplers that are not finite or have more than one axis.
    """
    taus, nus = _check_axis("delays", delays), _check_axis("dopplers", dopplers)
    chi = np.empty((len(taus), len(nus)), dtype=np.complex128)
    for i, tau in enumerate(taus):
        chi[i] = waveform.ambiguity_row(float(tau), nus)
    return chi


def zero_delay_cut(waveform: Waveform, dopplers: ArrayLike) -> ComplexArray:
    """chi(0, nu), (doppler,): the spectrum of the pulse's power; dopplers in Hz."""
    return ambiguity(waveform, 0.0, dopplers)[0]


def zero_doppler_cut(waveform: Waveform, delays: ArrayLike) -> ComplexArray:
    """chi(tau, 0), (delay,): the matched filter's response to a target at rest; delays in s."""
    return ambiguity(waveform, delays, 0.0)[:, 0]


def _check_axis(name: str, values: ArrayLike) -> FloatArray:
    """Return ``values`` as a finite array of one axis; otherwise raise an InputError."""
    axis = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if axis.ndim != 1:
        raise InputError(f"{name} has shape {axis.shape}, expected one axis")
    return check_finite(name, axis)
