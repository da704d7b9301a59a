"""The energy budget with occlusions that are known in advance."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from pydantic import NonNegativeInt

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError
from wavegym.core.parameters import Count, changed_default, parameter, system_parameters
from wavegym.core.system import ObservationField
from wavegym.systems.agile_clutter.state import Hypotheses
from wavegym.systems.energy_budget.state import World
from wavegym.systems.energy_budget.system import EnergyBudget
from wavegym.systems.visibility_windows import alternating_windows, given_windows, window_draws

FAR = 40  # steps: the observation shows a later change of the occlusion at this distance
CHANGES = 3  # changes of the occlusion that are observed


class Belief(NamedTuple):
    """The belief, the account and the occlusions of the whole episode."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    hypotheses: Hypotheses  # as in AgileClutter's belief
    energy: Array  # (env,) energy left; the longest pulse of one sensor costs 1
    visible: Array  # (env, H) bool: whether slot k, from step k to k + 1, is clear


@system_parameters
class EnergyBudgetKnown(EnergyBudget):
    """Two radars share an energy budget for a whole episode; all occlusions are known in advance.

    Description
        As wavegym/EnergyBudget-v0 with a stronger target, which is nearly always detected. Clear and occluded spells
        are drawn for each world, each length equally likely. They are known from the first step, like a scheduled
        blanking of a sector or terrain along a planned path. At each step the radars know whether the next slot is
        occluded. The spells are long, and the energy account pays for only four longest pulses, so the timing of each
        matters.

    Rewards
        As wavegym/AgileClutter-v0: -trace(Lambda P).

    Starting state
        As wavegym/EnergyBudget-v0. The episode begins anywhere in a clear spell or the occluded spell after it.

    Episode end
        Terminates after ``horizon`` steps. The remaining time is observed.

    References
        As wavegym/EnergyBudget-v0.
    """

    reference_range: float = changed_default(EnergyBudget, "reference_range", 100e3)
    budget: float = changed_default(EnergyBudget, "budget", 0.06)
    mean_clear: float = parameter(12.0, "not used", ge=1, le=1e6)
    mean_occluded: float = parameter(6.0, "not used", ge=1, le=1e6)
    shown: tuple[Count, Count] = parameter((8, 20), "minimum and maximum number of steps of a clear spell")
    hidden: tuple[NonNegativeInt, NonNegativeInt] = parameter(
        (8, 20), "minimum and maximum number of steps of an occluded spell"
    )
    windows: tuple[tuple[int, int], ...] = parameter(
        (), "(first step, last step) of each occluded spell, the same in every world; () draws the spells", unit=""
    )

    def __post_init__(self) -> None:
        """Check several fields together."""
        super().__post_init__()
        _ = self._occlusion_draws
        if self.windows and not self._given().any():
            raise InputError(f"windows is {self.windows}, expected at least one step of the episode outside them")

    def _given(self) -> Array:
        """Whether each slot is clear where windows are given, (H,) bool."""
        return given_windows([(0, *window) for window in self.windows], 1, self.horizon)[:, 0]

    @property
    def _occlusion_draws(self) -> int:
        """Uniform draws of one world's occlusions. InputError for spells of impossible lengths."""
        return window_draws(self.horizon, self.shown, self.hidden)

    def _first_occlusion(self, world: World) -> Array:
        if self.windows:
            return np.tile(self._given(), (len(world.occlusion), 1))
        return alternating_windows(world.occlusion, self.horizon, self.shown, self.hidden)

    def _belief(self, base: Any, energy: Array, occlusion: Array) -> Any:
        return Belief(base.step, base.mean, base.covariance, base.hypotheses, energy, occlusion)

    def _is_clear(self, belief: Any, world: World) -> Array:
        clear: Array = belief.visible[np.arange(len(belief.step)), belief.step]
        return clear

    def _occlusion_after(self, belief: Any, is_clear: Array) -> Array:
        visible: Array = belief.visible.copy()
        return visible

    def _clear_probability(self, belief: Any) -> Array:
        slot = np.minimum(belief.step, self.horizon - 1)
        return belief.visible[np.arange(len(slot)), slot].astype(np.float64)

    def _later_clear_probability(self, belief: Any, wait: Array) -> Array:
        slot = np.minimum(belief.step[:, None] + wait, self.horizon - 1)
        return np.take_along_axis(belief.visible, slot, axis=1).astype(np.float64)

    @property
    def outcome_shape(self) -> tuple[int, ...]:  # type: ignore[override]
        """A draw for every sensor and target, sensor by sensor: a detection."""
        return (len(self.sensors) * len(self.starts),)

    def _predict_slot(self, belief: Any, outcome: Array | None) -> tuple[Array, Array, Any]:
        return self._clear_probability(belief), belief.visible, None if outcome is None else self._by_sensor(outcome)

    def _occlusion_fields(self) -> tuple[ObservationField, ...]:
        return (
            ObservationField("occluded", "1", 0.5, 0.5, "whether the next slot is occluded"),
            *(
                ObservationField(
                    f"change_{k}", "steps", 10.0 * k, 10.0, f"steps until change {k} of the occlusion, at most {FAR}"
                )
                for k in range(1, CHANGES + 1)
            ),
            ObservationField("visible_ahead", "1", 0.5, 0.3, "share of the remaining slots that are clear"),
        )

    def _observed_occlusion(self, belief: Any) -> tuple[Array, ...]:
        slots, step = np.arange(self.horizon), belief.step[:, None]
        is_change = np.diff(belief.visible, axis=1, prepend=belief.visible[:, :1]) & (slots > step)
        nth = np.cumsum(is_change, axis=1) * is_change
        at = [nth == k for k in range(1, CHANGES + 1)]
        changes = [np.where(k.any(axis=1), np.minimum(k.argmax(axis=1) - belief.step, FAR), FAR) for k in at]
        ahead = (belief.visible & (slots >= step)).sum(axis=1) / np.maximum(self.horizon - belief.step, 1)
        return 1.0 - self._clear_probability(belief), *changes, ahead
