"""Map of targets before RF/EO platforms: trails, error ellipses, and each platform's field of view."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.rendering.drawings import KILO, ellipse, fill
from wavegym.rendering.maps import draw_track, to_scale
from wavegym.rendering.moment import Moment
from wavegym.rendering.panels import SMALL
from wavegym.systems.rf_eo.system import RfEo

if TYPE_CHECKING:
    from matplotlib.axes import Axes


PLANE = slice(0, None, 2)  # x and y among [x xdot y ydot]
IMAGE: dict[str, Any] = {"alpha": 0.16, "linewidth": 0.8}
UNAMBIGUOUS: dict[str, Any] = {"linewidth": 1.1, "linestyle": (0, (1.5, 1.5))}
POINTS = 181  # of a circle
DART = np.array([[0.0, 1.0], [0.65, -0.9], [0.0, -0.5], [-0.65, -0.9], [0.0, 1.0]])  # platform that looks along +y


def draw_platform_map(axes: Axes, system: RfEo, moment: Moment) -> None:
    """Draw targets with their trails, platforms and their fields of view; x and y to the same scale, in km."""
    now = moment.states[-1]
    truth = KILO * np.array([state.truth.targets[0, :, PLANE] for state in moment.states])  # (step, target, 2)
    mean = KILO * np.array([state.belief.mean[0, :, PLANE] for state in moment.states])
    spread = now.belief.covariance[0, :, PLANE, PLANE]
    outlines = [mean[-1, t, :, None] + KILO * ellipse(spread[t]) for t in range(len(spread))]
    places = KILO * np.array(system.platforms)
    to_scale(axes, np.concatenate([places.T, truth.reshape(-1, 2).T, *outlines], axis=1))
    _draw_fields(axes, system, moment, places)
    for t, outline in enumerate(outlines):
        draw_track(axes, t, truth[:, t], mean[:, t], outline)
    for j, place in enumerate(places):
        c, s = np.cos(system.places[j, 2]), np.sin(system.places[j, 2])
        dart = DART @ np.array([[c, -s], [s, c]])  # turned clockwise
        axes.plot(*place[:, None], marker=dart, color=f"C{j}", markersize=12, markeredgewidth=0)
        style: dict[str, Any] = {"color": f"C{j}", "fontsize": SMALL, "ha": "center", "va": "top"}
        axes.annotate(f"P{j + 1}", place, (0, -6), textcoords="offset points", **style)


def _draw_fields(axes: Axes, system: RfEo, moment: Moment, places: Array) -> None:
    """Draw each platform's camera sector, out to the map's edge, and the circle of its unambiguous range.

    The sector does not end at the circle: azimuth and range are measured independently of each other. With
    ``as_printed`` the arcsine also accepts the sector's mirror image behind the platform; it is not drawn.
    """
    if not moment.actions:
        return
    corners = np.array([(x, y) for x in axes.get_xlim() for y in axes.get_ylim()])
    far = 2.0 * np.hypot(*(corners[:, None] - places).T).max()  # a polygon of this size surrounds the map
    high = system.action_set.view(system.action_set.settings(moment.actions[-1]))[2][0]
    for j, (place, look) in enumerate(zip(places, system.places[:, 2], strict=True)):
        edge = min(high[j, 2], np.pi)
        arc = place[:, None] + far * _direction(look + np.linspace(-edge, edge, POINTS))
        fill(axes, np.concatenate([place[:, None], arc], axis=1), color=f"C{j}", **IMAGE)
        circle = place[:, None] + KILO * high[j, 0] * _direction(np.linspace(0.0, 2.0 * np.pi, POINTS))
        axes.plot(*circle, color=f"C{j}", **UNAMBIGUOUS)


def _direction(angle: Array) -> Array:
    """Unit vectors (2, ...) of angles in rad, clockwise from +y."""
    return np.stack([np.sin(angle), np.cos(angle)])
