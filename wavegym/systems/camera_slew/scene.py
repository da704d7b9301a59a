"""The scene of the turning camera: its image on the map, and the obstacles in its line of sight."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.rendering.looks import HIT, MISS, PLANE, Looks, LookScene
from wavegym.rendering.maps import KILO, Trails, direction, draw_trails, fill, sector, to_scale, trails_of
from wavegym.rendering.panels import Moment
from wavegym.systems.camera_slew.system import CameraSlew

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure


IMAGE: dict[str, Any] = {"color": "C0", "alpha": 0.18, "linewidth": 0}
BLIND: dict[str, Any] = {"color": "0.5", "alpha": 0.12, "linewidth": 0}
OBSTACLE: dict[str, Any] = {"color": "0.7", "linewidth": 4}
PLATFORM: dict[str, Any] = {"marker": "^", "markersize": 8, "markeredgewidth": 0, "linestyle": ""}
LEGEND: dict[str, dict[str, Any]] = {
    "image": {**IMAGE, "linewidth": 5},
    "blind": {**BLIND, "linewidth": 5, "alpha": 0.3},
    "line of sight blocked": OBSTACLE,
    "found": {"color": "C0", **HIT},
    "not found": {"color": "C0", **MISS},
}


class CameraScene(LookScene):
    """Map with the camera's image, position errors, windows in which targets hide, and looks.

    Args:
        system: the closed loop.
        figure: where to draw.
    """

    def __init__(self, system: CameraSlew, figure: SubFigure) -> None:
        super().__init__(system, figure, system.targets, "km", LEGEND)
        self.system = system

    def draw_map(self, moment: Moment) -> None:
        """Draw targets and their trails, the camera's image, and an obstacle before each hidden target."""
        belief, trails = moment.states[-1].belief, trails_of(moment, PLANE, KILO)
        places = KILO * np.array(self.system.platforms)
        to_scale(self.map, np.concatenate([places.T, trails.points], axis=1))
        style = BLIND if belief.settling[0] > 0 else IMAGE
        fill(self.map, sector(self.map, places[0], float(belief.pointing[0]), self.system.half_field), **style)
        if moment.actions:
            hidden = ~self.visible(moment)[len(moment.actions) - 1]
            self._draw_obstacles(places[0], trails, hidden)
        draw_trails(self.map, trails)
        for j, place in enumerate(places):
            self.map.plot(*place[:, None], color=f"C{j}", **PLATFORM)

    def _draw_obstacles(self, camera: Array, trails: Trails, hidden: Array) -> None:
        """Draw a bar across the line of sight to each target in ``hidden`` (target,) bool."""
        half = 0.03 * np.ptp(self.map.get_xlim())
        for place in trails.truth[-1, hidden]:
            sight = place - camera
            across = direction(np.arctan2(*sight) + 0.5 * np.pi)
            ends = camera + 0.85 * sight + half * np.array([[-1.0], [1.0]]) * across
            self.map.plot(*ends.T, **OBSTACLE)

    def visible(self, moment: Moment) -> Array:
        """See ``LookScene``."""
        visible: Array = moment.states[-1].belief.visible[0]
        return visible

    def looks(self, moment: Moment) -> Looks:
        """The chosen target of each step, and whether the camera found it."""
        chosen = np.array([int(action[0]) for action in moment.actions], np.int64)
        found = [state.truth.seen[0, t] for state, t in zip(moment.states[1:], chosen, strict=True)]
        return Looks(chosen[:, None], np.array(found, np.bool_)[:, None])

    def report(self, moment: Moment) -> str:
        """The target of the camera's turn, and the targets that the camera found in this step."""
        now, target = moment.states[-1], int(moment.actions[-1][0]) + 1
        found = ", ".join(str(t + 1) for t in np.flatnonzero(now.truth.seen[0])) or "none"
        settling = int(now.belief.settling[0])
        state = f"blind, {settling} step{'s' * (settling > 1)} to settle" if settling else "sees"
        return f"camera: towards target {target}, {state}  ·  targets found: {found}"
