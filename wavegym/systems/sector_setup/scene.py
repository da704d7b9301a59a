"""The scenes of the sector set-up: the path of the pulse on a map, in open terrain and in a city."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.shortcuts import target_of_action
from wavegym.rendering.looks import HIT, MISS, PLANE, Looks, LookScene
from wavegym.rendering.maps import KILO, Trails, draw_city, draw_trails, to_scale, trails_of
from wavegym.rendering.panels import Moment
from wavegym.systems.sector_setup.city import SectorSetupCity
from wavegym.systems.sector_setup.system import SectorSetup

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure


PULSE: dict[str, Any] = {"color": "C0", "linewidth": 1.3}
ECHO: dict[str, Any] = {**PULSE, "linewidth": 0.7}
SILENT: dict[str, Any] = {"color": "0.5", "linewidth": 1.1, "linestyle": (0, (2, 2))}
SENDER: dict[str, Any] = {"marker": "^", "color": "C0", "markersize": 8, "markeredgewidth": 0, "linestyle": ""}
RECEIVER: dict[str, Any] = {**SENDER, "marker": "v", "color": "black"}
LEGEND: dict[str, dict[str, Any]] = {
    "illuminator": SENDER,
    "receiver": RECEIVER,
    "pulse": PULSE,
    "set-up": SILENT,
    "detected": {"color": "C0", **HIT},
    "not": {"color": "C0", **MISS},
}


class SectorScene(LookScene):
    """Map with the path of the pulse, position errors, windows in which targets hide, and looks.

    Args:
        system: the closed loop.
        figure: where to draw.
    """

    scale: ClassVar[float] = KILO  # of the map
    unit: ClassVar[str] = "km"

    def __init__(self, system: SectorSetup, figure: SubFigure) -> None:
        super().__init__(system, figure, system.targets, self.unit, LEGEND)
        self.system = system

    def draw_map(self, moment: Moment) -> None:
        """Draw targets with their trails, illuminator, receivers, and the path of this step's pulse."""
        trails = trails_of(moment, PLANE, self.scale)
        sites = self.scale * np.array([self.system.illuminator, *self.system.receivers])
        to_scale(self.map, np.concatenate([sites.T, trails.points], axis=1))
        self.draw_ground()
        if moment.actions:
            self._draw_path(moment, trails, sites)
        self.map.plot(*sites[:1].T, **SENDER)
        self.map.plot(*sites[1:].T, **RECEIVER)
        draw_trails(self.map, trails)

    def draw_ground(self) -> None:
        """Draw the map under the targets; nothing in open terrain."""

    def _draw_path(self, moment: Moment, trails: Trails, sites: Array) -> None:
        """Draw lines from the illuminator over the target to the receivers, or the direction of the set-up."""
        target, is_silent = trails.truth[-1, self.looks(moment).target[-1, 0]], moment.states[-1].truth.silent[0]
        self.map.plot(*np.array([sites[0], target]).T, **(SILENT if is_silent else PULSE))
        for receiver in sites[1:] if not is_silent else ():
            self.map.plot(*np.array([target, receiver]).T, **ECHO)

    def visible(self, moment: Moment) -> Array:
        """See ``LookScene``."""
        visible: Array = moment.states[-1].truth.visible[0]
        return visible

    def looks(self, moment: Moment) -> Looks:
        """The target of each step, and whether a receiver detected it; no receiver does during a set-up."""
        target = np.array([target_of_action(self.system)[int(action[0]), 0] for action in moment.actions], np.int64)
        detected = np.array([state.truth.detections[0] > 0 for state in moment.states[1:]], np.bool_)
        return Looks(target[:, None], detected[:, None])

    def report(self, moment: Moment) -> str:
        """Whether a pulse was sent in this step, and how many receivers detected the target."""
        now, target = moment.states[-1], self.looks(moment).target[-1, 0] + 1
        if now.truth.silent[0]:
            return f"set-up for target {target}: no pulse; steps of it left: {now.belief.dead[0]}"
        return f"target {target}: detected by {now.truth.detections[0]} of {len(self.system.receivers)} receivers"


class CityScene(SectorScene):
    """``SectorScene`` on the map of a city, in metres."""

    scale: ClassVar[float] = 1.0
    unit: ClassVar[str] = "m"
    system: SectorSetupCity

    def draw_ground(self) -> None:
        """Draw roads and buildings."""
        draw_city(self.map, self.system.map)
