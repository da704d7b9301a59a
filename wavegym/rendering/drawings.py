"""Elements of pictures that several scenes share: error ellipses, true positions, transmitted pulses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.rendering.panels import caption, few_ticks
from wavegym.waveforms import Waveform, plot_ambiguity

if TYPE_CHECKING:
    from matplotlib.axes import Axes


KILO = 1e-3  # m -> km
SIGMAS = 2.0
CELLS = np.linspace(-3.0, 3.0, 25)  # delays and Dopplers of an ambiguity function, in resolution cells of its cuts
TRUTH = "black"
CROSS: dict[str, Any] = {"marker": "x", "color": TRUTH, "markersize": 6, "markeredgewidth": 1.4, "linestyle": ""}


def ellipse(covariance: Array, radius: float = SIGMAS) -> Array:
    """Points of the error ellipse of ``radius`` standard deviations, (2, point)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    return radius * np.linalg.cholesky(covariance) @ np.stack([np.cos(angle), np.sin(angle)])


def fill(axes: Axes, points: Array, **style: Any) -> None:
    """Fill the outline ``points`` (2, point); ``axes.fill`` is slower, because it also computes axis limits."""
    from matplotlib.patches import Polygon

    axes.add_artist(Polygon(points.T, **style))


def draw_pulse(axes: Axes, pulse: Waveform, title: str, small: bool = False) -> None:
    """Draw the ambiguity function of a transmitted pulse; ``small`` axes get few ticks and no text inside."""
    information = pulse.fisher_information()
    delays, dopplers = CELLS / np.sqrt(information[0, 0]), CELLS / np.sqrt(information[1, 1])
    plot_ambiguity(pulse, axes, delays=delays, dopplers=dopplers)
    axes.images[0].set_interpolation("bilinear")
    if small:
        few_ticks(axes, 2)
        for text in list(axes.texts):
            text.remove()
    caption(axes, title, "delay τ [µs]", "Doppler ν [kHz]")
