"""An illuminator that takes time to set up for another target."""

from __future__ import annotations

from wavegym.systems.sector_setup.system import SectorSetup

__all__ = ["SectorSetup"]
