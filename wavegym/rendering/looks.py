"""Scenes in which a sensor looks at one target at a time: map, position errors, and the looks of each sensor."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import System
from wavegym.rendering.maps import CROSS, SIGMAS, TRUTH, colour
from wavegym.rendering.panels import LINE, SMALL, Moment, caption, few_ticks, fit_y, legend, steps_along, wipe

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure


PLANE = slice(0, None, 2)  # x and y among [x xdot y ydot]
LEAST = 1e-3  # m: smaller errors, 0 included, are drawn here on the logarithmic axis
HIDDEN: dict[str, Any] = {"color": "0.82", "linewidth": 7, "solid_capstyle": "butt"}
NOW: dict[str, Any] = {"color": "black", "linewidth": 0.7}
HIT: dict[str, Any] = {"marker": "o", "linestyle": "", "markersize": 3.2, "markeredgewidth": 0.8}
MISS: dict[str, Any] = {**HIT, "markerfacecolor": "white"}
PLACE: dict[str, Any] = {"left": 0.09, "right": 0.96, "top": 0.85, "bottom": 0.075, "wspace": 0.22, "hspace": 0.3}
PLACE["height_ratios"] = (1.7, 1.0)
TARGET: dict[str, dict[str, Any]] = {"target": CROSS, f"{SIGMAS:g}σ": {"color": TRUTH, "linewidth": 1.4}}
APART = 0.36  # rows between the marks of the first and the last sensor


class Looks(NamedTuple):
    """The targets at which every sensor looked in each step so far."""

    target: Array  # (step, sensor) int; -1 for none
    hit: Array  # (step, sensor) bool: drawn filled


class LookScene(ABC):
    """A map above, position errors and looks below.

    Args:
        system: the closed loop.
        figure: where to draw.
        targets: number of targets.
        unit: of the map.
        entries: of the legend, behind those of targets.
    """

    def __init__(
        self, system: System, figure: SubFigure, targets: int, unit: str, entries: dict[str, dict[str, Any]]
    ) -> None:
        grid = figure.add_gridspec(2, 2, **PLACE)
        self.map = figure.add_subplot(grid[0, :])
        self._errors, self._looks = (figure.add_subplot(grid[1, i]) for i in range(2))
        self._report = figure.text(0.033, 0.918, "", fontsize=SMALL + 0.5, va="center")
        few_ticks(self.map)
        caption(self.map, "", f"x [{unit}]", f"y [{unit}]")
        shown = {**TARGET, **entries, "hidden": {**HIDDEN, "linewidth": 5}}
        legend(self.map, (-0.07, 1.0 + 0.45 * LINE / self.map.bbox.height), len(shown), **shown)
        prepare_position_errors(self._errors, system.horizon)
        prepare_looks(self._looks, targets, system.horizon, "looks at each target, and where it hides")

    def draw(self, moment: Moment) -> None:
        """See ``Scene``."""
        for axes in (self.map, self._errors, self._looks):
            wipe(axes)
        self._report.set_text(self.report(moment) if moment.actions else "")
        self.draw_map(moment)
        draw_position_errors(self._errors, moment, PLANE)
        draw_looks(self._looks, self.visible(moment), self.looks(moment))

    @abstractmethod
    def draw_map(self, moment: Moment) -> None:
        """Draw targets and sensors in ``map``."""

    @abstractmethod
    def report(self, moment: Moment) -> str:
        """The result of the last step, in a line."""

    @abstractmethod
    def looks(self, moment: Moment) -> Looks:
        """The looks so far."""

    @abstractmethod
    def visible(self, moment: Moment) -> Array:
        """Whether each target is visible from step k to k + 1, (H, target) bool."""


def prepare_position_errors(axes: Axes, horizon: int) -> None:
    """Caption and limits of the panel that ``draw_position_errors`` fills."""
    caption(axes, "position error, 1σ of the belief dashed", "step", "[m]")
    few_ticks(axes)
    steps_along(axes, horizon)


def draw_position_errors(axes: Axes, moment: Moment, plane: slice, shown: Array | None = None) -> None:
    """Each target's distance from the estimate to the truth, and its root mean square according to the belief.

    Args:
        axes: a panel of ``prepare_position_errors``.
        moment: what the episode was until now.
        plane: picks x and y from a state.
        shown: which targets have a curve at each step, (step, target) bool; by default all at all steps.
    """
    errors = [state.belief.mean[0] - state.truth.targets[0] for state in moment.states]
    distance = np.maximum(np.hypot(*np.array(errors)[..., plane].T), LEAST)  # (target, step)
    variances = np.array([np.diagonal(state.belief.covariance[0], axis1=1, axis2=2) for state in moment.states])
    sigma = np.sqrt(variances[..., plane].sum(axis=-1)).T
    if shown is not None:
        distance, sigma = (np.where(shown.T, values, np.nan) for values in (distance, sigma))
    for t, (error, spread) in enumerate(zip(distance, sigma, strict=True)):
        axes.plot(error, color=colour(t), linewidth=0.8, alpha=0.6)
        axes.plot(spread, color=colour(t), linewidth=1.3, linestyle=(0, (3, 2)))
        axes.plot([len(error) - 1], error[-1:], "o", color=colour(t), markersize=3)
    curves = np.stack([distance, sigma])
    if np.isfinite(curves).any():
        fit_y(axes, curves[np.isfinite(curves)])


def prepare_looks(axes: Axes, targets: int, horizon: int, title: str) -> None:
    """Caption and limits of the panel that ``draw_looks`` fills."""
    caption(axes, title, "step")
    few_ticks(axes)
    steps_along(axes, horizon)
    axes.set_ylim(targets - 0.4, -0.6)
    axes.set_yticks(range(targets), [str(t + 1) for t in range(targets)])
    for t, label in enumerate(axes.get_yticklabels()):
        label.set(color=colour(t), fontweight="bold")
    axes.tick_params(axis="y", length=0)


def draw_looks(axes: Axes, visible: Array, looks: Looks) -> None:
    """A row for each target: bars where it is hidden, a mark where a sensor looked at it.

    Args:
        axes: a panel of ``prepare_looks``.
        visible: (H, target) bool, from step k to k + 1.
        looks: of the steps so far.
    """
    for t, column in enumerate(visible.T):
        edges = np.flatnonzero(np.diff(np.concatenate([[True], column, [True]]).astype(np.int64)))
        for first, last in edges.reshape(-1, 2):
            axes.plot([first, last], [t, t], **HIDDEN)
    sensors = looks.target.shape[1]
    for j in range(sensors):
        shift = APART * (j / (sensors - 1) - 0.5) if sensors > 1 else 0.0
        for hit, style in ((True, HIT), (False, MISS)):
            steps = np.flatnonzero((looks.target[:, j] >= 0) & (looks.hit[:, j] == hit))
            axes.plot(steps + 0.5, looks.target[steps, j] + shift, color=f"C{j}", **style)
    axes.axvline(len(looks.target), **NOW)
