"""Ambiguity function, its cuts and its picture, for any waveform.

chi(tau, nu) = int s(t) s*(t - tau) exp(-j 2 pi nu t) dt, so chi(0, 0) = 1 and the ridge of an up-chirp has positive
slope in the (delay, Doppler) plane.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import FloatArray, check_finite
from wavegym.core.errors import InputError
from wavegym.waveforms.waveform import Waveform

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

ComplexArray = NDArray[np.complex128]
_POINTS = 241
_REACH = 5.0  # half the window, in resolution cells of the cuts
_HALF_POWER = float(np.sqrt(0.5))
_MICRO, _KILO = 1e6, 1e-3  # s -> us, Hz -> kHz


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


def plot_ambiguity(
    waveform: Waveform,
    axes: Axes | None = None,
    *,
    delays: ArrayLike | None = None,
    dopplers: ArrayLike | None = None,
    floor_db: float | None = None,
) -> Figure:
    """Draw |chi(tau, nu)| with its half-power contour, and the zero-Doppler and zero-delay cuts beside it.

    Args:
        waveform: any waveform.
        axes: draw the plane alone, in these axes; a new figure with plane, cuts and colour bar if None.
        delays: evenly spaced and rising, s, (delay,); default five resolution cells 1/sqrt(J) on each side.
        dopplers: evenly spaced and rising, Hz, (doppler,); default as for delays.
        floor_db: draw decibels down to this value (e.g. -60) instead of the linear magnitude.

    Returns:
        The matplotlib figure; ``figure.savefig("ambiguity.png")`` writes it.

    Raises:
        InputError: delays or dopplers that are not evenly spaced and rising, or a floor_db that is not < 0.
    """
    if floor_db is not None and not floor_db < 0:
        raise InputError(f"floor_db is {floor_db!r}, expected a number < 0, such as -60")
    taus, nus = _window(waveform, delays, dopplers)
    if axes is not None:
        _draw_plane(axes, waveform, taus, nus, floor_db)
        axes.set_title(waveform.label)
        return axes.figure.figure
    return _plane_and_cuts(waveform, taus, nus, floor_db)


def _plane_and_cuts(waveform: Waveform, taus: FloatArray, nus: FloatArray, floor_db: float | None) -> Figure:
    """A figure of the plane with its colour bar, the zero-Doppler cut above it and the zero-delay cut beside it."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 6.4), layout="constrained")
    grid = figure.add_gridspec(2, 3, width_ratios=(4, 1.3, 0.14), height_ratios=(1.3, 4))
    plane = figure.add_subplot(grid[1, 0])
    image = _draw_plane(plane, waveform, taus, nus, floor_db)
    scale = "|χ|" if floor_db is None else "|χ| [dB]"
    figure.colorbar(image, cax=figure.add_subplot(grid[1, 2]), label=scale)
    above = figure.add_subplot(grid[0, 0], sharex=plane)
    above.plot(taus * _MICRO, _scaled(zero_doppler_cut(waveform, taus), floor_db), color="black", linewidth=1)
    above.set_ylabel(scale)
    above.set_title("zero-Doppler cut", fontsize="medium")
    beside = figure.add_subplot(grid[1, 1], sharey=plane)
    beside.plot(_scaled(zero_delay_cut(waveform, nus), floor_db), nus * _KILO, color="black", linewidth=1)
    beside.set_xlabel(scale)
    beside.set_title("zero-delay cut", fontsize="medium")
    limits = (0, 1.05) if floor_db is None else (floor_db, 3)
    above.set_ylim(limits)
    beside.set_xlim(limits)
    for cut in (above, beside):
        cut.grid(alpha=0.3)
    above.tick_params(labelbottom=False)
    beside.tick_params(labelleft=False)
    figure.suptitle(f"Ambiguity function: {waveform.label}")
    return figure


def _window(waveform: Waveform, delays: ArrayLike | None, dopplers: ArrayLike | None) -> tuple[FloatArray, FloatArray]:
    """The given delays and dopplers; by default resolution cells of the cuts, so that a thin long ridge is visible."""
    information = waveform.fisher_information()
    unit = np.linspace(-_REACH, _REACH, _POINTS)
    taus = unit / np.sqrt(information[0, 0]) if delays is None else _check_even("delays", delays)
    nus = unit / np.sqrt(information[1, 1]) if dopplers is None else _check_even("dopplers", dopplers)
    return taus, nus


def _check_even(name: str, values: ArrayLike) -> FloatArray:
    """Return ``values`` as an array if they rise in equal steps; otherwise raise an InputError."""
    axis = np.asarray(values, dtype=np.float64)
    steps = np.diff(axis) if axis.ndim == 1 else np.zeros(0)
    if not (steps.size and steps.min() > 0 and np.ptp(steps) <= 1e-6 * steps.max()):
        found = f"steps from {steps.min():g} to {steps.max():g}" if steps.size else f"shape {axis.shape}"
        raise InputError(f"{name} has {found}, expected at least two numbers, rising and evenly spaced")
    return axis


def _draw_plane(axes: Axes, waveform: Waveform, taus: FloatArray, nus: FloatArray, floor_db: float | None) -> AxesImage:
    magnitude = np.abs(ambiguity(waveform, taus, nus)).T  # (doppler, delay)
    x, y = taus * _MICRO, nus * _KILO
    image = axes.imshow(
        _scaled(magnitude, floor_db),
        extent=(*_outer_edges(x), *_outer_edges(y)),
        origin="lower",
        aspect="auto",
        cmap="viridis",
        vmin=0 if floor_db is None else floor_db,
        vmax=1 if floor_db is None else 0,
    )
    if magnitude.min() < _HALF_POWER < magnitude.max():
        axes.contour(x, y, magnitude, levels=[_HALF_POWER], colors="white", linewidths=0.8)
        axes.annotate(
            "contour: half power (−3 dB)", (0.02, 0.02), xycoords="axes fraction", color="white", fontsize="small"
        )
    axes.set(xlabel="delay τ [µs]", ylabel="Doppler ν [kHz]")
    axes.locator_params(axis="x", nbins=6)
    return image


def _scaled(chi: NDArray, floor_db: float | None) -> FloatArray:
    magnitude = np.abs(chi)
    if floor_db is None:
        return magnitude
    return 20 * np.log10(np.maximum(magnitude, 10 ** (floor_db / 20)))


def _outer_edges(x: FloatArray) -> tuple[float, float]:
    """Ends of an image whose pixel centres are ``x``."""
    half = 0.5 * (x[-1] - x[0]) / max(1, len(x) - 1)
    return (float(x[0] - half), float(x[-1] + half))
