"""The scene of a system in a frame: its geometry, and the waveform that was chosen.

A scene is a class that takes the system and a figure. ``wavegym.register(id, system, scene=...)`` gives it to the
system's class and its subclasses. A system without a scene gets a picture of its observation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wavegym.core.build import load_object
from wavegym.core.system import System
from wavegym.registration import scene_of
from wavegym.rendering.panels import Moment, Scene, caption, few_ticks, wipe

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure


def make_scene(system: System, figure: SubFigure) -> Scene:
    """The scene of a system, by its class. Raises an InputError for a place where there is no scene."""
    kind = scene_of(type(system)) or ObservationScene
    scene: Scene = (load_object("scene", kind) if isinstance(kind, str) else kind)(system, figure)
    return scene


class ObservationScene:
    """The fields of the observation, for a system that has no scene of its own.

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
        fields = moment.system.observation_fields
        values = moment.system.observe(moment.states[-1].belief)[0]
        scaled = [(value - f.centre) / f.scale for f, value in zip(fields, values, strict=True)]
        units = ["" if f.unit == "1" else f" {f.unit}" for f in fields]
        labels = [f"{f.name} = {value:.3g}{unit}" for f, value, unit in zip(fields, values, units, strict=True)]
        wipe(self._axes)
        self._axes.barh(np.arange(len(fields)), scaled, color="tab:blue")
        self._axes.axvline(0.0, color="black", linewidth=0.6)
        self._axes.set_yticks(np.arange(len(fields)), labels, fontsize=7)
        reach = 1.1 * max(3.0, *np.abs(scaled))
        self._axes.set(xlim=(-reach, reach), ylim=(len(fields) - 0.4, -0.6))
