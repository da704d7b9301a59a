"""Libraries of chirps, and the measurement covariances of a library."""

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
    """Covariances of (range in m, range-rate in m/s) at SNR 1, (waveform, 2, 2); divide by eta for another SNR.

    Raises:
        InputError: an entry that is not a waveform, or a carrier_hz that is not a finite number > 0.
    """
    for entry in library:
        if not isinstance(entry, Waveform):
            raise InputError(f"library holds {entry!r}, expected waveforms only")
    return np.stack([waveform.measurement_covariance(carrier_hz, 1.0) for waveform in library])


def gaussian_chirp_library(durations: Iterable[float], sweeps: Iterable[float]) -> Library:
    """All Gaussian chirps of the given durations and sweeps; the sweep varies fastest.

    Args:
        durations: k, s.
        sweeps: Hz swept in two durations, g = pi |sweep|/(2 k); positive for an up-chirp, negative for a down-chirp,
            0 (once) for an unmodulated pulse.

    Raises:
        InputError: a duration not > 0, a sweep that is not finite, a repeated value, or no values.
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
    """All trapezoid chirps of the given laws, durations, sweeps and directions; the direction varies fastest.

    Args:
        kinds: laws such as ``"lfm"``, ``"pfm"``, ``"pfm:2.5"``, ``"hfm:0.3"``: a kind, and its shape if not default.
        durations: lam, s.
        sweeps: D, Hz.
        directions: ``"up"``, ``"down"`` or both.

    Raises:
        InputError: a value that ``TrapezoidChirp`` refuses, a repeated waveform (sweep 0 gives the same waveform for
            each kind and direction), or no values.
    """
    laws = [parse_law(kind) for kind in kinds]
    lengths, widths, senses = [float(k) for k in durations], [float(sweep) for sweep in sweeps], list(directions)
    return Library(
        tuple(
            TrapezoidChirp(kind=kind, shape=shape, duration=duration, sweep=sweep, direction=direction)
            for kind, shape in laws
            for duration in lengths
            for sweep in widths
            for direction in senses
        )
    )
