"""Maps of targets: trails and error ellipses to scale, and the lines of sight to distant sensors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import State
from wavegym.rendering.drawings import CROSS, KILO, ellipse
from wavegym.rendering.moment import Moment
from wavegym.rendering.panels import SMALL
from wavegym.systems.agile_clutter.system import AgileClutter

if TYPE_CHECKING:
    from matplotlib.axes import Axes


PLANE = slice(0, 2)  # x and y among [x y xdot ydot]
COLOURS = ("teal", "darkmagenta", "saddlebrown", "navy", "darkolivegreen", "crimson")  # C0, C1, ... are sensors
PARTICLE: dict[str, Any] = {"linestyle": "", "marker": ".", "markersize": 2.5, "markeredgewidth": 0, "alpha": 0.2}
SPARE = 1.2  # of the map's extent, for names


def colour(target: int) -> str:
    """Of a target, in all panels."""
    return COLOURS[target % len(COLOURS)]


def cross(target: int) -> dict[str, Any]:
    """How its true place is marked."""
    return {**CROSS, "color": colour(target)}


def known_targets(system: AgileClutter, step: int) -> list[int]:
    """Targets of which the tracker has an estimate: those that it has just been handed are measured a step later."""
    return [t for t, birth in enumerate(system.births) if birth <= step <= birth + system.lifetime]


def draw_map(axes: Axes, system: AgileClutter, moment: Moment) -> None:
    """Known targets with their trails, and where the sensors are; x and y to the same scale, in km."""
    now = moment.states[-1]
    known = known_targets(system, len(moment.actions))
    centre = _fit(axes, system, now, known)
    _draw_lines_of_sight(axes, system, now, known, centre)
    for t in known:
        since = moment.states[system.births[t] :]
        truth = KILO * np.array([state.truth.targets[0, t, PLANE] for state in since])
        mean = KILO * np.array([state.belief.mean[0, t, PLANE] for state in since])
        draw_particles(axes, now, t, np.zeros(2), KILO)
        draw_track(axes, t, truth, mean, _outline(now, t))


def draw_track(axes: Axes, target: int, truth: Array, mean: Array, outline: Array) -> None:
    """A target's true path and estimates, (step, 2) each, the error ellipse (2, point) and its number."""
    shade = colour(target)
    axes.plot(*truth.T, color=shade, linewidth=0.8)
    axes.plot(*mean.T, ".", color=shade, markersize=3.5)
    axes.plot(*outline, color=shade, linewidth=1.4)
    axes.plot(*truth[-1:].T, **cross(target))
    style: dict[str, Any] = {"color": shade, "fontsize": 10, "fontweight": "bold"}
    axes.annotate(str(target + 1), truth[-1], (7, 3), textcoords="offset points", **style)


def to_scale(axes: Axes, points: Array) -> Array:
    """Limits around points (2, point), x and y to the same scale; their middle (2,)."""
    low, high = points.min(axis=1), points.max(axis=1)
    pixels = np.array([axes.bbox.width, axes.bbox.height])
    half = 0.5 * SPARE * pixels * ((high - low) / pixels).max()
    middle = 0.5 * (low + high)
    (left, bottom), (right, top) = middle - half, middle + half
    axes.set(xlim=(left, right), ylim=(bottom, top))
    return middle


def draw_particles(axes: Axes, now: State, target: int, origin: Array, scale: float = 1.0) -> None:
    """Each particle's mean as a faint point, where the tracker has particles."""
    if now.belief.particles is not None:
        points = scale * (now.belief.particles.mean[0, :, target, PLANE] - origin)
        axes.plot(*points.T, color=colour(target), **PARTICLE)


def _outline(now: State, target: int) -> Array:
    """Error ellipse around the estimate, (2, point) in km."""
    belief = now.belief
    return KILO * (belief.mean[0, target, PLANE, None] + ellipse(belief.covariance[0, target, PLANE, PLANE]))


def _fit(axes: Axes, system: AgileClutter, now: State, known: list[int]) -> Array:
    """Limits around all of the episode's true paths and the present ellipses; the centre of what is known, km."""
    until = [min(system.lifetime, max(system.horizon - birth, 0)) + 1 for birth in system.births]
    paths = [KILO * now.truth.path[0, t, :end, PLANE].T for t, end in enumerate(until)]
    middle = to_scale(axes, np.concatenate([*paths, *(_outline(now, t) for t in known)], axis=1))
    return KILO * now.belief.mean[0, known, PLANE].mean(axis=0) if known else middle


def _draw_lines_of_sight(axes: Axes, system: AgileClutter, now: State, known: list[int], centre: Array) -> None:
    """From each target to each sensor, whose name stands where the line from ``centre`` leaves the map."""
    low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
    for i, position in enumerate(system.sensors):
        sensor = KILO * np.array(position)
        targets = KILO * now.belief.mean[0, known, PLANE]
        ways = np.stack([targets, 0.0 * targets + sensor, 0.0 * targets + np.nan], axis=1)  # (target, end, 2)
        axes.plot(*ways.reshape(-1, 2).T, color=f"C{i}", linewidth=0.7, linestyle=(0, (4, 3)), alpha=0.7)
        step = sensor - centre
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.nanmin(np.where(step > 0, high - centre, low - centre) / step)
        x, y = (centre + min(share, 1.0) * step - low) / (high - low)
        if share > 1.0:  # the sensor is on the map
            axes.plot(*sensor, "^", color=f"C{i}", markersize=6)
        axes.text(
            min(max(x, 0.03), 0.97),
            min(max(y, 0.02), 0.98),
            f"to sensor {i + 1}: {np.hypot(*step):.1f} km",
            transform=axes.transAxes,
            color=f"C{i}",
            fontsize=SMALL,
            ha="left" if x < 0.3 else "right" if x > 0.7 else "center",
            va="bottom" if y < 0.5 else "top",
            bbox={"color": "white", "alpha": 0.7, "pad": 1.0},
        )
