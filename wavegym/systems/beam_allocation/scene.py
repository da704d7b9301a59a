"""The scene of the beams: agile clutter's, with the windows in which targets hide and where each beam was."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wavegym.core.shortcuts import target_of_action
from wavegym.rendering.looks import Looks, draw_looks, prepare_looks
from wavegym.rendering.panels import Moment, wipe
from wavegym.systems.agile_clutter.scene import TargetScene
from wavegym.systems.beam_allocation.system import BeamAllocation
from wavegym.waveforms import Waveform

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure
    from matplotlib.gridspec import SubplotSpec


class BeamScene(TargetScene):
    """Map, errors and gates; below them every beam's target in each step, filled where the target was visible."""

    system: BeamAllocation

    def add_lowest(self, figure: SubFigure, place: SubplotSpec) -> None:
        """See ``TargetScene``."""
        self._beams = figure.add_subplot(place)
        prepare_looks(self._beams, len(self.system.starts), self.system.horizon, "beams; grey: the target hides")

    def draw_lowest(self, moment: Moment, pulses: list[Waveform | None]) -> None:
        """See ``TargetScene``."""
        wipe(self._beams)
        visible = moment.states[-1].belief.visible[0]
        rows = [target_of_action(self.system)[int(action[0])] for action in moment.actions]
        target = np.array(rows, np.int64).reshape(len(rows), len(self.system.sensors))
        draw_looks(self._beams, visible, Looks(target, visible[np.arange(len(target))[:, None], target]))
