"""The scene of the multifunction radar: the region with its tracks and the beam, and the shares of the time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import State
from wavegym.core.traits import CONFIRMED
from wavegym.rendering.maps import CROSS, KILO, direction, ellipse, fill, sector, to_scale
from wavegym.rendering.panels import Moment, caption, few_ticks, legend, wipe
from wavegym.systems.multifunction_radar.area_kernels import axis_of, next_beam
from wavegym.systems.multifunction_radar.state import estimates, states_now
from wavegym.systems.multifunction_radar.step_kernels import SEARCH, UPDATE
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure

ARC = 61  # points
TRACK: dict[str, Any] = {"color": "tab:blue", "linewidth": 1.2}
TENTATIVE: dict[str, Any] = {"color": "tab:orange", "linewidth": 0.9}
BEAM: dict[str, Any] = {"color": "tab:red", "alpha": 0.5, "linewidth": 0}
SHADE: dict[str, Any] = {"color": "0.35", "linewidth": 0}
DARKEST = 0.45  # opacity of a cell whose number of undetected targets is that without any search
EDGE: dict[str, Any] = {"color": "0.4", "linewidth": 0.8}
SPENT = (("update", UPDATE, "tab:blue"), ("search", SEARCH, "tab:red"))


class RegionScene:
    """Above: true targets (crosses), tracks, the beam, and undetected targets in grey. Below: the shares of the time.

    Args:
        system: the closed loop.
        figure: where to draw.
    """

    def __init__(self, system: MultifunctionRadar, figure: SubFigure) -> None:
        self.system = system
        place = {"left": 0.13, "right": 0.97, "top": 0.87, "bottom": 0.1, "hspace": 0.4, "height_ratios": (3, 1)}
        self._map, self._shares = figure.subplots(2, 1, gridspec_kw=place)
        caption(self._map, "targets ×, tracks, beam; grey: undetected", "km", "km")
        legend(self._map, "lower left", confirmed=TRACK, tentative=TENTATIVE)
        caption(self._shares, "share of the time spent so far", "s")
        legend(self._shares, "upper right", 2, **{name: {"color": shade} for name, _, shade in SPENT})
        for axes in (self._map, self._shares):
            few_ticks(axes)
        self._shares.set(xlim=(0.0, system.seconds), ylim=(0.0, 1.25))

    def draw(self, moment: Moment) -> None:
        """See ``Scene``."""
        wipe(self._map)
        wipe(self._shares)
        now, region = moment.states[-1], self._cell(0.0, 1.0, 0.0, 1.0)
        to_scale(self._map, np.concatenate([region, np.zeros((2, 1))], axis=1))
        self._draw_undetected(self.system.by_sector(now.belief.undetected[0].sum(axis=-1)))
        self._map.plot(*region, **EDGE)
        if moment.actions:
            self._draw_beam(moment)
        self._draw_tracks(now)
        self._draw_shares(moment)

    def _cell(self, left: float, right: float, low: float, high: float) -> Array:
        """Closed outline (2, point), km, of shares of the sector and of the range."""
        traffic = self.system.traffic
        across = direction(traffic.half_sector * (2.0 * np.linspace(left, right, ARC) - 1.0))
        inner, outer = (traffic.nearest + share * (traffic.farthest - traffic.nearest) for share in (low, high))
        ends = np.concatenate([inner * across, outer * across[:, ::-1]], axis=1)
        return KILO * np.concatenate([ends, ends[:, :1]], axis=1)

    def _draw_undetected(self, undetected: Array) -> None:
        sectors, bins = undetected.shape
        usual = self.system.by_sector(self.system.usual_numbers)
        for (s, b), number in np.ndenumerate(undetected):
            opacity = DARKEST * float(np.clip(number / usual[s, b] if usual[s, b] > 0.0 else 0.0, 0.0, 2.0))
            if opacity > 0.01:
                cell = self._cell(s / sectors, (s + 1) / sectors, b / bins, (b + 1) / bins)
                fill(self._map, cell, alpha=opacity, **SHADE)

    def _draw_beam(self, moment: Moment) -> None:
        """The beam of the last dwell."""
        system, before, after = self.system, moment.states[-2].belief, moment.states[-1]
        kind, which = (int(column[int(moment.actions[-1][0])]) for column in (system.menu.kind, system.menu.which))
        if kind == SEARCH:
            axis = axis_of(next_beam(which, int(before.turn[0, which]), system.area), system.area)
        elif kind == UPDATE and not after.truth.replaced[0]:
            mean = estimates(before._replace(time=after.belief.time), system.modes).mean[0, which]
            axis = mean[0] / np.hypot(mean[0], mean[2])
        else:
            return
        azimuth = np.arcsin(axis)
        half = 0.5 * system.beam.width / np.cos(azimuth)  # the beam is of constant width in the sine
        fill(self._map, sector(self._map, np.zeros(2), azimuth, half), **BEAM)

    def _draw_tracks(self, now: State) -> None:
        truth, belief = now
        x = states_now(truth, belief.time - truth.cell * self.system.cell)[0][truth.here[0]]
        self._map.plot(*(KILO * x[:, [0, 2]]).T, **CROSS)
        made = estimates(belief, self.system.modes)
        for k in np.flatnonzero(belief.existence[0] > 0.0).tolist():
            outline = ellipse(made.covariance[0, k][np.ix_([0, 2], [0, 2])], 5.0) + made.mean[0, k, [0, 2], None]
            self._map.plot(*(KILO * outline), **(TRACK if belief.existence[0, k] >= CONFIRMED else TENTATIVE))

    def _draw_shares(self, moment: Moment) -> None:
        """Shares of updates and of searches in the time so far."""
        if not moment.actions:
            return
        kind = self.system.menu.kind[np.concatenate(moment.actions)]
        time = np.array([state.belief.time[0] for state in moment.states[1:]])
        duration = np.array([state.belief.duration[0] for state in moment.states[1:]])
        for _, wanted, shade in SPENT:
            self._shares.plot(time, np.cumsum(duration * (kind == wanted)) / time, color=shade, linewidth=1.2)
