"""Elements of pictures that several scenes share: targets on maps, error ellipses, transmitted pulses, cities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import State
from wavegym.rendering.panels import Moment, caption, few_ticks
from wavegym.sensors.urban_map import UrbanMap
from wavegym.trackers import GaussianMixture, Particles
from wavegym.waveforms import Waveform, plot_ambiguity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

KILO = 1e-3  # m -> km
SIGMAS = 2.0
CELLS = np.linspace(-3.0, 3.0, 25)  # delays and Dopplers of an ambiguity function, in resolution cells of its cuts
TRUTH = "black"
CROSS: dict[str, Any] = {"marker": "x", "color": TRUTH, "markersize": 6, "markeredgewidth": 1.4, "linestyle": ""}
PLANE = slice(0, 2)  # x and y among [x y xdot ydot]
# of targets; C0, C1, ... are sensors
COLOURS = ("teal", "darkmagenta", "saddlebrown", "navy", "darkolivegreen", "crimson")
PARTICLE: dict[str, Any] = {"linestyle": "", "marker": ".", "markersize": 2.5, "markeredgewidth": 0, "alpha": 0.2}
POINTS = 181  # of a circle
ROAD: dict[str, Any] = {"color": "0.93", "linewidth": 0}
BUILDING: dict[str, Any] = {"facecolor": "0.72", "edgecolor": "0.45", "linewidth": 0.8}
TREE: dict[str, Any] = {"linestyle": "", "marker": "o", "color": "yellowgreen", "markersize": 3, "markeredgewidth": 0}
SPARE = 1.2  # extent of the map over that of its points, with room for names


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


class Trails(NamedTuple):
    """Paths of all targets until now, in the units of the map."""

    truth: Array  # (step, target, 2)
    mean: Array  # (step, target, 2)
    outlines: Array  # (target, 2, point): error ellipses of now

    @property
    def points(self) -> Array:
        """All points, (2, point)."""
        return np.concatenate([self.truth.reshape(-1, 2).T, *self.outlines], axis=1)


def trails_of(moment: Moment, plane: slice, scale: float = 1.0) -> Trails:
    """The trails of an episode; ``plane`` picks x and y from a state, ``scale`` times metres is the map's unit."""
    truth = scale * np.array([state.truth.targets[0, :, plane] for state in moment.states])
    mean = scale * np.array([state.belief.mean[0, :, plane] for state in moment.states])
    spread = moment.states[-1].belief.covariance[0, :, plane, plane]
    return Trails(
        truth, mean, np.array([m[:, None] + scale * ellipse(P) for m, P in zip(mean[-1], spread, strict=True)])
    )


def draw_trails(axes: Axes, trails: Trails) -> None:
    """Draw every target's true path, estimates and error ellipse."""
    for t, outline in enumerate(trails.outlines):
        draw_track(axes, t, trails.truth[:, t], trails.mean[:, t], outline)


def sector(axes: Axes, place: Array, look: float, half: float) -> Array:
    """Outline (2, point) of the sector that ``place`` (2,) sees, out beyond the map's edge.

    ``look`` is the azimuth of its middle, clockwise from +y, and ``half`` half its width, rad.
    """
    corners = np.array([(x, y) for x in axes.get_xlim() for y in axes.get_ylim()])
    far = 2.0 * np.hypot(*(corners - place).T).max()
    arc = place[:, None] + far * direction(look + np.linspace(-half, half, POINTS))
    return np.concatenate([place[:, None], arc], axis=1)


def direction(angle: Array) -> Array:
    """Unit vectors (2, ...) of angles in rad, clockwise from +y."""
    return np.stack([np.sin(angle), np.cos(angle)])


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
    if isinstance(hypotheses, GaussianMixture):
        means = hypotheses.mean[0, target, hypotheses.weight[0, target] > 0.0]
    elif isinstance(hypotheses, Particles):
        means = hypotheses.mean[0, :, target]
    else:
        return
    points = scale * (means[:, PLANE] - origin)
    axes.plot(*points.T, color=colour(target), **PARTICLE)


def draw_city(axes: Axes, city: UrbanMap) -> None:
    """Draw the roads, buildings and trees of an urban map, in m."""
    from shapely.plotting import patch_from_polygon

    axes.add_artist(patch_from_polygon(city.paved, **ROAD))
    for building in city.buildings:
        fill(axes, np.array(building.corners).T, **BUILDING)
    axes.plot(*np.array(city.discretes).reshape(-1, 2).T, **TREE)
