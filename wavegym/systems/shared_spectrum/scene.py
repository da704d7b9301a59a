"""The scene of a shared band: a waterfall of the spectrum with the radar's bands, and the range error below it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.rendering.panels import Moment, caption, draw_range_error, few_ticks, legend, steps_along, wipe
from wavegym.systems.shared_spectrum.kernels import BUSY
from wavegym.systems.shared_spectrum.system import SharedSpectrum

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure


STRONGEST = 30.0  # dB over the receiver's noise at the end of the colour scale
CLEAR: dict[str, Any] = {"color": "tab:green", "linewidth": 2.2}
STRUCK: dict[str, Any] = {"color": "tab:red", "linewidth": 2.2}


class BandScene:
    """Waterfall of the noise that was heard with the band of each train, above the range error.

    Args:
        system: the closed loop.
        figure: where to draw.
    """

    def __init__(self, system: SharedSpectrum, figure: SubFigure) -> None:
        self.system = system
        grid = figure.add_gridspec(
            2, 1, left=0.14, right=0.97, top=0.87, bottom=0.08, hspace=0.4, height_ratios=(2.2, 1.0)
        )
        self._waterfall, self._error = (figure.add_subplot(grid[row, 0]) for row in range(2))
        few_ticks(self._error)
        for axes in (self._waterfall, self._error):
            steps_along(axes, system.horizon)
        edges = system.carrier_hz / 1e6 + system.channel_width / 1e6 * (
            np.arange(system.channels + 1) - system.channels / 2
        )
        self._edges = edges
        self._waterfall.set_ylim(edges[0], edges[-1])
        legend(self._waterfall, "upper right", 2, clear_band=CLEAR, band_with_other_users=STRUCK)

    def draw(self, moment: Moment) -> None:
        """See ``Scene``."""
        for axes in (self._waterfall, self._error):
            wipe(axes)
        self._draw_waterfall(moment)
        draw_range_error(self._error, moment)

    def _draw_waterfall(self, moment: Moment) -> None:
        """Noise in each channel and step, darker where it is stronger, and the edges of the radar's bands."""
        axes, system, belief = self._waterfall, self.system, moment.states[-1].belief
        steps = len(moment.actions)
        caption(axes, "noise of other users (grey), and the band of each train", "step", "MHz")
        heard = 0.5 * belief.heard[0, system.history : system.history + steps].T
        if steps:
            axes.pcolormesh(np.arange(steps + 1), self._edges, heard, cmap="Greys", vmin=0.0, vmax=STRONGEST)
        for k, action in enumerate(moment.actions):
            band = system.band_of(action)[0]
            low, high = system.bands.first[band], system.bands.first[band] + system.bands.width[band]
            style = STRUCK if (heard[low:high, k] >= 0.5 * BUSY).any() else CLEAR
            axes.plot([k + 0.5] * 2, self._edges[[low, high]], solid_capstyle="butt", **style)
