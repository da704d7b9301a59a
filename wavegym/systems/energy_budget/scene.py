"""The scene of the energy budget: agile clutter's, with the account and the occlusions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.rendering.panels import Moment, caption, few_ticks, steps_along, wipe
from wavegym.systems.agile_clutter.scene import TargetScene
from wavegym.systems.energy_budget.system import EnergyBudget
from wavegym.waveforms import Waveform

if TYPE_CHECKING:
    from matplotlib.figure import SubFigure
    from matplotlib.gridspec import SubplotSpec


OCCLUDED: dict[str, Any] = {"color": "0.85", "linewidth": 0}
PACE: dict[str, Any] = {"color": "0.4", "linewidth": 0.8, "linestyle": (0, (3, 2))}
LEFT: dict[str, Any] = {"color": "tab:green", "linewidth": 1.4, "drawstyle": "steps-post"}


class AccountScene(TargetScene):
    """Map, errors and gates; below them the energy left against an even pace, with occluded slots in grey."""

    system: EnergyBudget

    def add_lowest(self, figure: SubFigure, place: SubplotSpec) -> None:
        """See ``TargetScene``."""
        self._account = figure.add_subplot(place)
        caption(self._account, "energy left, even pace dashed; grey: occluded", "step", "longest pulses")
        few_ticks(self._account)
        steps_along(self._account, self.system.horizon)
        self._account.set_ylim(0.0, 1.06 * self.system.total)

    def draw_lowest(self, moment: Moment, pulses: list[Waveform | None]) -> None:
        """See ``TargetScene``."""
        axes, system = self._account, self.system
        wipe(axes)
        for slot in np.flatnonzero(occluded_slots(moment)).tolist():
            axes.axvspan(slot, slot + 1, **OCCLUDED)
        axes.plot([0, system.horizon], [system.total, 0.0], **PACE)
        axes.plot([state.belief.energy[0] for state in moment.states], **LEFT)


def occluded_slots(moment: Moment) -> Array:
    """Which slots are occluded, bool: those so far, or of the whole episode where they are known."""
    known = getattr(moment.states[-1].belief, "visible", None)
    if known is not None:
        return ~known[0]
    return np.array([state.truth.occluded[0] for state in moment.states[1:]], np.bool_)
