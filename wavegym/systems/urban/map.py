"""Drawn urban map: buildings, roads, antennas, targets and tracks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.rendering.maps import colour, cross, draw_city, ellipse, to_scale
from wavegym.rendering.panels import Moment
from wavegym.systems.urban.system import Urban
from wavegym.systems.urban.tracker import CONFIRMED, TENTATIVE, Tracks

if TYPE_CHECKING:
    from matplotlib.axes import Axes


PLANE = slice(0, 2)  # x and y among [x y xdot ydot xddot yddot]
DIRECT_PATH: dict[str, Any] = {"linewidth": 0.7, "linestyle": (0, (4, 3)), "alpha": 0.6}
TRANSMITTER: dict[str, Any] = {"linestyle": "", "marker": "^", "color": "black", "markersize": 7, "markeredgewidth": 0}
RECEIVER: dict[str, Any] = {"linestyle": "", "marker": "v", "markersize": 6, "markeredgewidth": 0}
TRAIL: dict[str, Any] = {"linestyle": "", "marker": ".", "color": "black", "markersize": 2.5, "markeredgewidth": 0}
SURE: dict[str, Any] = {"color": "black", "linewidth": 1.3}
UNSURE: dict[str, Any] = {"color": "darkorange", "linewidth": 1.1, "linestyle": (0, (2, 1.2))}


def draw_urban_map(axes: Axes, system: Urban, moment: Moment) -> None:
    """Targets and tracks with their trails, tracks with 2 sigma ellipses; x and y to the same scale, in m.

    Lines join a target to the first transmitter and the receivers while the direct paths of the first two pairs are
    visible.
    """
    scene, step, now = system.truth_model.scene, len(moment.actions), moment.states[-1]
    driven = np.array([state.truth.targets[0, :, PLANE] for state in moment.states])
    senders = len(system.transmitters)
    antennas = np.array([*system.transmitters, *system.receivers])
    places = np.delete(antennas, range(1, senders), axis=0)
    to_scale(axes, np.concatenate([scene.truth[scene.present][:, PLANE], antennas]).T)
    draw_city(axes, system.map)
    for t in np.flatnonzero(scene.present[step]).tolist():
        trail = driven[scene.present[: step + 1, t], t]
        if scene.direct[step, t]:
            lines = np.stack([places, np.broadcast_to(trail[-1], places.shape), np.full(places.shape, np.nan)], axis=1)
            axes.plot(*lines.reshape(-1, 2).T, color=colour(t), **DIRECT_PATH)
        axes.plot(*trail.T, color=colour(t), linewidth=1.0)
        axes.plot(*trail[-1:].T, **cross(t))
        style: dict[str, Any] = {"color": colour(t), "fontsize": 10, "fontweight": "bold"}
        axes.annotate(str(t + 1), trail[-1], (7, 5), textcoords="offset points", annotation_clip=True, **style)
    confirmed = [Tracks(*state.belief[1:]).combined()[0][state.belief.status == CONFIRMED] for state in moment.states]
    axes.plot(*np.concatenate(confirmed)[:, PLANE].T, **TRAIL)
    x, P = Tracks(*now.belief[1:]).combined()
    for status, style in ((TENTATIVE, UNSURE), (CONFIRMED, SURE)):
        for slot in np.flatnonzero(now.belief.status[0] == status):
            axes.plot(*(x[0, slot, PLANE, None] + ellipse(P[0, slot, PLANE, PLANE])), **style)
    axes.plot(*antennas[:senders].T, **TRANSMITTER)
    for i, place in enumerate(antennas[senders:]):
        axes.plot(*place[:, None], color=f"C{i}", **RECEIVER)
