"""One beam a sensor and several targets that hide."""

from __future__ import annotations

from wavegym.systems.beam_allocation import shortcuts  # noqa: F401  (registers them)
from wavegym.systems.beam_allocation.system import BeamAllocation

__all__ = ["BeamAllocation"]
