"""An energy account that must last for the episode."""

from __future__ import annotations

from wavegym.systems.energy_budget import shortcuts  # noqa: F401  (registers them)
from wavegym.systems.energy_budget.system import EnergyBudget

__all__ = ["EnergyBudget"]
