"""What the scenes of several systems draw: error ellipses, the truth, the pulse that was transmitted."""

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
CELLS = np.linspace(-3.0, 3.0, 25)  # of the ambiguity function, in resolution cells of its cuts
TRUTH = "black"
CROSS: dict[str, Any] = {"marker": "x", "color": TRUTH, "markersize": 6, "markeredgewidth": 1.4, "linestyle": ""}


def ellipse(covariance: Array, radius: float = SIGMAS) -> Array:
    """Points of the ellipse of so many standard deviations, (2, point)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    return radius * np.linalg.cholesky(covariance) @ np.stack([np.cos(angle), np.sin(angle)])


def fill(axes: Axes, points: Array, **style: Any) -> None:
    """A filled outline, points (2, point). ``axes.fill`` would measure each side for limits that scenes set anyway."""
    from matplotlib.patches import Polygon

    axes.add_artist(Polygon(points.T, **style))


def draw_pulse(axes: Axes, pulse: Waveform, title: str, small: bool = False) -> None:
    """Ambiguity function of a pulse that was transmitted; small axes have room for few ticks and no remarks."""
    information = pulse.fisher_information()
    delays, dopplers = CELLS / np.sqrt(information[0, 0]), CELLS / np.sqrt(information[1, 1])
    plot_ambiguity(pulse, axes, delays=delays, dopplers=dopplers)
    axes.images[0].set_interpolation("bilinear")
    if small:
        few_ticks(axes, 2)
        for text in list(axes.texts):
            text.remove()
    caption(axes, title, "delay τ [µs]", "Doppler ν [kHz]")
