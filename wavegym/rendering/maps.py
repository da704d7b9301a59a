"""Elements of target maps: colours, tracks, particles, and axis limits with equal scales in x and y."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import State
from wavegym.rendering.drawings import CROSS
from wavegym.trackers import GaussianMixture

if TYPE_CHECKING:
    from matplotlib.axes import Axes


PLANE = slice(0, 2)  # x and y among [x y xdot ydot]
# of targets; C0, C1, ... are sensors
COLOURS = ("teal", "darkmagenta", "saddlebrown", "navy", "darkolivegreen", "crimson")
PARTICLE: dict[str, Any] = {"linestyle": "", "marker": ".", "markersize": 2.5, "markeredgewidth": 0, "alpha": 0.2}
SPARE = 1.2  # extent of the map over that of its points, with room for names


def colour(target: int) -> str:
    """The colour of a target in all panels."""
    return COLOURS[target % len(COLOURS)]


def cross(target: int) -> dict[str, Any]:
    """Line properties of the mark at a target's true position."""
    return {**CROSS, "color": colour(target)}


def draw_track(axes: Axes, target: int, truth: Array, mean: Array, outline: Array) -> None:
    """Draw a target's true path and estimates, (step, 2) each, the error ellipse (2, point) and its number."""
    shade = colour(target)
    axes.plot(*truth.T, color=shade, linewidth=0.8)
    axes.plot(*mean.T, ".", color=shade, markersize=3.5)
    axes.plot(*outline, color=shade, linewidth=1.4)
    axes.plot(*truth[-1:].T, **cross(target))
    style: dict[str, Any] = {"color": shade, "fontsize": 10, "fontweight": "bold"}
    axes.annotate(str(target + 1), truth[-1], (7, 3), textcoords="offset points", **style)


def to_scale(axes: Axes, points: Array) -> Array:
    """Set limits around ``points`` (2, point) with equal scales in x and y; return the centre of the map (2,)."""
    low, high = points.min(axis=1), points.max(axis=1)
    pixels = np.array([axes.bbox.width, axes.bbox.height])
    half = 0.5 * SPARE * pixels * ((high - low) / pixels).max()
    middle = 0.5 * (low + high)
    (left, bottom), (right, top) = middle - half, middle + half
    axes.set(xlim=(left, right), ylim=(bottom, top))
    return middle


def draw_hypotheses(axes: Axes, now: State, target: int, origin: Array, scale: float = 1.0) -> None:
    """Draw the mean of each particle or component as a faint point, if the tracker has hypotheses."""
    hypotheses = now.belief.hypotheses
    if hypotheses is None:
        return
    if isinstance(hypotheses, GaussianMixture):
        means = hypotheses.mean[0, target, hypotheses.weight[0, target] > 0.0]
    else:
        means = hypotheses.mean[0, :, target]
    points = scale * (means[:, PLANE] - origin)
    axes.plot(*points.T, color=colour(target), **PARTICLE)
