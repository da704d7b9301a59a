"""Map of targets before RF/EO platforms: trails, error ellipses, and each platform's field of view."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.rendering.maps import KILO, POINTS, direction, draw_track, fill, sector, to_scale, trails_of
from wavegym.rendering.panels import SMALL, Moment
from wavegym.systems.rf_eo.system import RfEo

if TYPE_CHECKING:
    from matplotlib.axes import Axes


PLANE = slice(0, None, 2)  # x and y among [x xdot y ydot]
IMAGE: dict[str, Any] = {"alpha": 0.16, "linewidth": 0.8}
UNAMBIGUOUS: dict[str, Any] = {"linewidth": 1.1, "linestyle": (0, (1.5, 1.5))}
DART = np.array([[0.0, 1.0], [0.65, -0.9], [0.0, -0.5], [-0.65, -0.9], [0.0, 1.0]])  # platform that looks along +y


def draw_platform_map(axes: Axes, system: RfEo, moment: Moment) -> None:
    """Draw targets with their trails, platforms and their fields of view; x and y to the same scale, in km."""
    trails, places = trails_of(moment, PLANE, KILO), KILO * np.array(system.platforms)
    to_scale(axes, np.concatenate([places.T, trails.points], axis=1))
    _draw_fields(axes, system, moment, places)
    here = targets_shown(system, moment)
    for t in np.flatnonzero(here[-1]).tolist():
        steps = here[:, t]
        draw_track(axes, t, trails.truth[steps, t], trails.mean[steps, t], trails.outlines[t])
    looks = moment.states[-1].belief.looks[0]
    for j, place in enumerate(places):
        c, s = np.cos(looks[j]), np.sin(looks[j])
        dart = DART @ np.array([[c, -s], [s, c]])  # turned clockwise
        axes.plot(*place[:, None], marker=dart, color=f"C{j}", markersize=12, markeredgewidth=0)
        style: dict[str, Any] = {"color": f"C{j}", "fontsize": SMALL, "ha": "center", "va": "top"}
        axes.annotate(f"P{j + 1}", place, (0, -6), textcoords="offset points", **style)


def targets_shown(system: RfEo, moment: Moment) -> Array:
    """Which targets are in the scene, or enter it, at each state of the episode, (step, target) bool."""
    steps = np.array([state.belief.step[0] for state in moment.states])
    shows: Array = system.present(steps) | system.present(steps + 1)
    return shows


def _draw_fields(axes: Axes, system: RfEo, moment: Moment, places: Array) -> None:
    """Draw each platform's camera sector, out to the map's edge, and the circle of its unambiguous range.

    The sector does not end at the circle: azimuth and range are measured independently of each other. With
    ``as_printed`` the arcsine also accepts the sector's mirror image behind the platform; it is not drawn.
    """
    if not moment.actions:
        return
    high = system.action_set.view(system.action_set.settings(moment.actions[-1]))[2][0]
    for j, (place, look) in enumerate(zip(places, moment.states[-1].belief.looks[0], strict=True)):
        fill(axes, sector(axes, place, look, min(high[j, 2], np.pi)), color=f"C{j}", **IMAGE)
        circle = place[:, None] + KILO * high[j, 0] * direction(np.linspace(0.0, 2.0 * np.pi, POINTS))
        axes.plot(*circle, color=f"C{j}", **UNAMBIGUOUS)
