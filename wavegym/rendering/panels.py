"""The data of a frame, the protocol of the scenes that draw it, and axes that last for a whole film.

Axes are made and labelled once, cleared and filled for each frame. Matplotlib spends most of its time on making axes
and ticks and on measuring text; lasting axes halve it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from wavegym.core.action_sets import action_label
from wavegym.core.arrays import Array
from wavegym.core.system import State, System

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SMALL = 7.5  # font size in points
ERROR = "tab:blue"
LINE = 13.0  # pixels between lines of small text


class Moment(NamedTuple):
    """One environment's episode so far; arrays of states and actions have a leading axis of one."""

    system: System
    states: list[State]  # at steps 0, 1, ..., now
    actions: list[Array]  # each (1, ...), one fewer than states
    costs: Array  # (step,), one for each state

    def label(self, action: Array) -> str:
        """A short name of ``action``, (1,) or (1, ...)."""
        return action_label(self.system.actions, action)


class Scene(Protocol):
    """Draws frames in one figure: axes are made once and cleared for each frame."""

    def draw(self, moment: Moment) -> None:
        """Draw ``moment``; nothing of an earlier frame remains."""


def caption(axes: Axes, title: str, x: str = "", y: str = "") -> None:
    """Title and axis labels in small text at fixed positions."""
    axes.set_title(title, fontsize=SMALL + 0.5, y=1.0 + 0.4 * LINE / axes.bbox.height, pad=0.0)
    axes.set_xlabel(x, fontsize=SMALL)
    axes.set_ylabel(y, fontsize=SMALL)
    axes.xaxis.set_label_coords(0.5, -1.8 * LINE / axes.bbox.height)
    axes.yaxis.set_label_coords(-2.6 * LINE / axes.bbox.width, 0.5)
    axes.tick_params(labelsize=SMALL - 0.5)


def draw_range_error(axes: Axes, moment: Moment) -> None:
    """Error of the range along the line of sight over time, within two standard deviations of the filter."""
    error = np.array([state.belief.mean[0, 0] - state.truth.targets[0, 0] for state in moment.states])
    band = 2.0 * np.sqrt([state.belief.covariance[0, 0, 0] for state in moment.states])
    steps = np.arange(len(error))
    axes.fill_between(steps, -band, band, color=ERROR, alpha=0.2, linewidth=0)
    axes.plot(steps, error, color=ERROR, linewidth=1)
    axes.plot(steps[-1:], error[-1:], "o", color=ERROR, markersize=4)
    axes.axhline(0.0, color="black", linewidth=0.6)
    settled = slice(min(len(error) - 1, 2), None)  # the first estimates are far worse than all others
    reach = 1.3 * max(band[settled].max(), np.abs(error[settled]).max())
    axes.set_ylim(-reach, reach)
    caption(axes, f"range: estimated minus true, within the filter's ±2σ = {band[-1]:.3g} m", "step", "error [m]")


def few_ticks(axes: Axes, most: int = 4) -> None:
    """At most ``most`` intervals between round ticks along linear axes."""
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(_round_ticks(most))


def wipe(axes: Axes) -> None:
    """Remove the contents of the last frame; captions, ticks and legend stay."""
    for artist in [*axes.lines, *axes.patches, *axes.collections, *axes.images, *axes.texts]:
        artist.remove()
    axes.relim()  # no artists: the last frame's data no longer affect the limits
    axes.set_prop_cycle(None)


def steps_along(axes: Axes, horizon: int) -> None:
    """Set the x limits to the steps of an episode."""
    axes.set_xlim(-0.02 * horizon, 1.02 * horizon)


def fit_y(axes: Axes, values: Array) -> None:
    """Set y limits around ``values``; logarithmic if they are positive and span more than a factor of three."""
    from matplotlib.ticker import LogLocator, NullLocator

    low, high = float(np.min(values)), float(np.max(values))
    if low > 0 and high > 3.0 * low:
        axes.set_yscale("log")
        spare = (high / low) ** 0.08
        axes.set_ylim(low / spare, high * spare)
        subs = (1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,)
        axes.yaxis.set_major_locator(LogLocator(subs=subs, numticks=6))
        axes.yaxis.set_minor_locator(NullLocator())
    else:
        axes.set_yscale("linear")
        spare = 0.08 * (high - low) or 0.1 * abs(high) or 1.0
        axes.set_ylim(low - spare, high + spare)
        axes.yaxis.set_major_locator(_round_ticks(4))
    axes.yaxis.set_major_formatter("{x:g}")


def _round_ticks(most: int) -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(most, steps=[1, 2, 5, 10])


def legend(axes: Axes, place: Any, columns: int = 1, /, **entries: dict[str, Any]) -> None:
    """A legend that stays in all frames: a name and the line properties of each entry."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], label=name.replace("_", " "), **style) for name, style in entries.items()]
    style = {"fontsize": SMALL - 1, "handlelength": 1.2, "columnspacing": 1.2, "borderpad": 0.3, "framealpha": 0.7}
    axes.legend(handles=handles, loc=place, ncols=columns, **style)
