"""The scene of a target on the line of sight: where it is, how well it is known, and what the pulse added."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wavegym.core.action_sets import ParameterBox
from wavegym.core.arrays import Array
from wavegym.rendering.maps import CROSS, KILO, SIGMAS, TRUTH, draw_pulse, ellipse, fill
from wavegym.rendering.panels import Moment, caption, draw_range_error, few_ticks, legend, steps_along, wipe
from wavegym.sensors import range_law_snr
from wavegym.systems.kershaw_evans.shortcuts import next_pulse
from wavegym.systems.kershaw_evans.system import MEASURED, KershawEvans
from wavegym.waveforms import GaussianChirp, Waveform, chirp_rate_for_sweep

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure


PREDICTED, PULSE, UPDATED = "0.5", "tab:orange", "tab:blue"


class LineOfSightScene:
    """Line of sight, range error over time, error ellipses before and after the pulse, ambiguity function.

    Args:
        system: the closed loop.
        figure: where to draw.
    """

    def __init__(self, system: KershawEvans, figure: SubFigure) -> None:
        self.system = system
        grid = figure.add_gridspec(
            3, 2, left=0.1, right=0.97, top=0.87, bottom=0.08, hspace=0.55, wspace=0.34, height_ratios=(0.25, 0.8, 1.6)
        )
        self._sight = figure.add_subplot(grid[0, :])
        self._error, self._pulse = figure.add_subplot(grid[1, :]), figure.add_subplot(grid[2, 1])
        self._ellipses = figure.add_subplot(grid[2, 0])
        for axes in (self._sight, self._error, self._ellipses, self._pulse):
            few_ticks(axes)
        self._sight.set(yticks=[], ylim=(-1.0, 1.0))
        self._sight.spines[["left", "right", "top"]].set_visible(False)
        self._sight.xaxis.set_major_formatter("{x:g} km")
        steps_along(self._error, system.horizon)
        caption(self._ellipses, "2σ ellipses around the estimate", "range [m]", "range-rate [m/s]")
        legend(
            self._ellipses,
            "upper left",
            predicted={"color": PREDICTED, "linestyle": "--"},
            the_pulse_alone={"color": PULSE},
            updated={"color": UPDATED, "linewidth": 5, "alpha": 0.35},
            truth=CROSS,
        )

    def draw(self, moment: Moment) -> None:
        """See ``Scene``."""
        for axes in (self._sight, self._error, self._ellipses, self._pulse):
            wipe(axes)
        self._draw_line_of_sight(moment)
        draw_range_error(self._error, moment)
        self._draw_ellipses(moment)
        self._pulse.set_visible(bool(moment.actions))
        if moment.actions:
            pulse = transmitted(self.system, moment.actions[-1])
            draw_pulse(self._pulse, pulse, f"ambiguity function |χ|: {pulse.label}")

    def _draw_line_of_sight(self, moment: Moment) -> None:
        """Radar, target and where it has been."""
        axes, now = self._sight, moment.states[-1]
        path = KILO * np.concatenate([state.truth.targets[:, 0] for state in moment.states])
        axes.plot(path, np.zeros(len(path)), color=PREDICTED, linewidth=3, alpha=0.5, solid_capstyle="butt")
        axes.plot([0.0], [0.0], ">", color=TRUTH, markersize=8, clip_on=False)
        axes.plot(path[-1:], [0.0], **CROSS)
        axes.plot(KILO * now.belief.mean[:, 0], [0.0], "o", color=UPDATED, markersize=9, fillstyle="none")
        axes.set_xlim(0.0, 1.15 * max(path.max(), 1.0))
        eta = 10.0 * np.log10(self._snr(moment))
        where = f"{path[-1]:.2f} km, {now.truth.targets[0, 1]:+.0f} m/s, SNR η = {eta:.1f} dB"
        caption(axes, f"line of sight from the radar ▸ to the true × and estimated ○ target: {where}")

    def _draw_ellipses(self, moment: Moment) -> None:
        """Predicted, measured with the chosen pulse alone, and updated; and the truth."""
        axes, system, now = self._ellipses, self.system, moment.states[-1]
        updated = now.belief.covariance[0, :MEASURED, :MEASURED]
        predicted = updated
        if moment.actions:
            predicted = next_pulse(system, moment.states[-2].belief)[0][0, :MEASURED, :MEASURED]
            R = system.unit_covariance(moment.actions[-1])[0] / self._snr(moment)
            axes.plot(*ellipse(predicted), "--", color=PREDICTED, linewidth=1.2)
            axes.plot(*ellipse(R), color=PULSE, linewidth=1.2)
        fill(axes, ellipse(updated), color=UPDATED, alpha=0.35)
        truth = (now.truth.targets - now.belief.mean)[0, :MEASURED]
        axes.plot(truth[:1], truth[1:], **CROSS)
        reach = 1.35 * np.maximum(SIGMAS * np.sqrt(np.diag(predicted)), np.abs(truth))
        axes.set(xlim=(-reach[0], reach[0]), ylim=(-reach[1], reach[1]))

    def _snr(self, moment: Moment) -> float:
        """eta at the true range, that of the received pulse."""
        r = moment.states[-1].truth.targets[0, 0]
        return float(range_law_snr(abs(r), self.system.reference_range, self.system.nearest_range))


def transmitted(system: KershawEvans, action: Array) -> Waveform:
    """The pulse that ``action``, (1,) or (1, d), stands for."""
    actions = system.actions
    if not isinstance(actions, ParameterBox):
        return actions[int(action[0])]
    duration, sweep = actions.decode(action)[0].tolist()
    rate = float(chirp_rate_for_sweep(abs(sweep), duration))
    return GaussianChirp(duration=duration, chirp_rate=rate, direction="down" if sweep < 0 else "up")
