"""What a system says of itself in a frame: geometry, and the waveform that was chosen.

A system of your own gets a picture of its observation. To draw more, register what makes its scene::

    @make_scene.register
    def _(system: MySystem, figure: SubFigure) -> Scene:
        return MyScene(system, figure)
"""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.system import System
from wavegym.rendering.moment import Moment, Scene
from wavegym.rendering.panels import caption, few_ticks, wipe
from wavegym.systems.agile_clutter.scene import TargetScene
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.systems.kershaw_evans.scene import LineOfSightScene
from wavegym.systems.kershaw_evans.system import KershawEvans
from wavegym.systems.rf_eo.scene import PlatformScene
from wavegym.systems.rf_eo.system import RfEo
from wavegym.systems.urban.scene import UrbanScene
from wavegym.systems.urban.system import Urban

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure


class ObservationScene:
    """The elements of the observation, for a system that has no scene of its own.

    Args:
        system: the closed loop.
        figure: where to draw.
    """

    def __init__(self, system: System, figure: SubFigure) -> None:
        self._axes = figure.subplots(gridspec_kw={"left": 0.4, "right": 0.96, "top": 0.87, "bottom": 0.08})
        caption(self._axes, "observation", "(value - centre) / scale, as agents see it")
        few_ticks(self._axes)

    def draw(self, moment: Moment) -> None:
        """See ``Scene``."""
        elements = moment.system.observation_fields
        values = moment.system.observe(moment.states[-1].belief)[0]
        scaled = [(value - e.centre) / e.scale for e, value in zip(elements, values, strict=True)]
        units = ["" if e.unit == "1" else f" {e.unit}" for e in elements]
        labels = [f"{e.name} = {value:.3g}{unit}" for e, value, unit in zip(elements, values, units, strict=True)]
        wipe(self._axes)
        self._axes.barh(np.arange(len(elements)), scaled, color="tab:blue")
        self._axes.axvline(0.0, color="black", linewidth=0.6)
        self._axes.set_yticks(np.arange(len(elements)), labels, fontsize=7)
        reach = 1.1 * max(3.0, *np.abs(scaled))
        self._axes.set(xlim=(-reach, reach), ylim=(len(elements) - 0.4, -0.6))


@singledispatch
def make_scene(system: Any, figure: SubFigure) -> Scene:
    """The scene of a system, by its class."""
    return ObservationScene(system, figure)


make_scene.register(KershawEvans, LineOfSightScene)
make_scene.register(AgileClutter, TargetScene)
make_scene.register(RfEo, PlatformScene)
make_scene.register(Urban, UrbanScene)
