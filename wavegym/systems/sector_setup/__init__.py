"""An illuminator that needs set-up time when it changes its target."""

from __future__ import annotations

from wavegym.systems.sector_setup import shortcuts  # noqa: F401  (registers them)
from wavegym.systems.sector_setup.system import SectorSetup

__all__ = ["SectorSetup"]
