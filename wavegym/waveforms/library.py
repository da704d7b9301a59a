"""Libraries of chirps, and how well each waveform of a library measures."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from wavegym.core.action_sets import Library
from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_positive
from wavegym.waveforms.chirp_laws import parse_law
from wavegym.waveforms.gaussian import DIRECTIONS, GaussianChirp, chirp_rate_for_sweep
from wavegym.waveforms.trapezoid import TrapezoidChirp
from wavegym.waveforms.waveform import Waveform


def measurement_covariances(library: Library, carrier_hz: float) -> FloatArray:
    """Covariances of (range in m, range-rate in m/s) at SNR 1, (waveform, 2, 2); divide by eta.

    Raises:
        InputError: if the library holds something else than waveforms, or carrier_hz is not a finite number > 0.
    """
    for entry in library:
        if not isinstance(entry, Waveform):
            raise InputError(f"library holds {entry!r}, expected waveforms only")
    return np.stack([waveform.measurement_covariance(carrier_hz, 1.0) for waveform in library])


def gaussian_chirp_library(durations: Iterable[float], sweeps: Iterable[float]) -> Library:
    """All Gaussian chirps of some durations and sweeps, duration by duration, the sweeps in the order given.

    Args:
        durations: k, s.
        sweeps: Hz swept in two durations, so that g = pi |sweep|/(2 k); positive is an up-chirp, negative a
            down-chirp, 0 (once) an unmodulated pulse.

    Raises:
        InputError: if a duration is not > 0, a sweep is not finite, one is repeated, or there are none.
    """
    rows, columns = [float(k) for k in durations], [float(sweep) for sweep in sweeps]
    for k in rows:
        check_positive("duration", k, "s")
    for sweep in columns:
        if not math.isfinite(sweep):
            raise InputError(f"sweep is {sweep} Hz, expected a finite number")
    return Library(
        tuple(
            GaussianChirp(
                duration=k,
                chirp_rate=float(chirp_rate_for_sweep(abs(sweep), k)),
                direction="down" if sweep < 0 else "up",
            )
            for k in rows
            for sweep in columns
        )
    )


def trapezoid_chirp_library(
    kinds: Iterable[str],
    durations: Iterable[float],
    sweeps: Iterable[float],
    directions: Iterable[str] = DIRECTIONS,
) -> Library:
    """All trapezoid chirps of some laws, durations, sweeps and directions; the last varies fastest.

    Args:
        kinds: laws such as ``"lfm"``, ``"pfm"``, ``"pfm:2.5"``, ``"hfm:0.3"``: a kind, and its shape if not the usual.
        durations: lam, s.
        sweeps: D, Hz.
        directions: ``"up"``, ``"down"`` or both.

    Raises:
        InputError: if a value is one that ``TrapezoidChirp`` refuses, a waveform is repeated (an unmodulated one, of
            sweep 0, is the same in every kind and direction), or there are none.
    """
    laws = [parse_law(kind) for kind in kinds]
    lengths, widths, ways = [float(k) for k in durations], [float(sweep) for sweep in sweeps], list(directions)
    return Library(
        tuple(
            TrapezoidChirp(kind=kind, shape=shape, duration=duration, sweep=sweep, direction=direction)
            for kind, shape in laws
            for duration in lengths
            for sweep in widths
            for direction in ways
        )
    )
