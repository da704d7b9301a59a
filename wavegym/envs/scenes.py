"""The scene of each system in a frame: its geometry, and the waveform that was chosen.

A system without a scene gets a picture of its observation. Register a scene for a system of your own::

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
from wavegym.systems.beam_allocation.scene import BeamScene
from wavegym.systems.beam_allocation.system import BeamAllocation
from wavegym.systems.camera_slew.scene import CameraScene
from wavegym.systems.camera_slew.system import CameraSlew
from wavegym.systems.energy_budget.scene import AccountScene
from wavegym.systems.energy_budget.system import EnergyBudget
from wavegym.systems.kershaw_evans.scene import LineOfSightScene
from wavegym.systems.kershaw_evans.system import KershawEvans
from wavegym.systems.multifunction_radar.scene import RegionScene
from wavegym.systems.multifunction_radar.system import MultifunctionRadar
from wavegym.systems.rf_eo.scene import PlatformScene
from wavegym.systems.rf_eo.system import RfEo
from wavegym.systems.sector_setup.city import SectorSetupCity
from wavegym.systems.sector_setup.scene import CityScene, SectorScene
from wavegym.systems.sector_setup.system import SectorSetup
from wavegym.systems.urban.scene import UrbanScene
from wavegym.systems.urban.system import Urban

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure


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


@singledispatch
def make_scene(system: Any, figure: SubFigure) -> Scene:
    """The scene of a system, by its class."""
    return ObservationScene(system, figure)


make_scene.register(BeamAllocation, BeamScene)
make_scene.register(EnergyBudget, AccountScene)
make_scene.register(CameraSlew, CameraScene)
make_scene.register(KershawEvans, LineOfSightScene)
make_scene.register(AgileClutter, TargetScene)
make_scene.register(MultifunctionRadar, RegionScene)
make_scene.register(RfEo, PlatformScene)
make_scene.register(SectorSetup, SectorScene)
make_scene.register(SectorSetupCity, CityScene)
make_scene.register(Urban, UrbanScene)
