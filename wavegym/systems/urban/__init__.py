"""A multistatic radar in urban terrain (Barbosa et al.)."""

from __future__ import annotations

from wavegym.systems.urban import shortcuts  # noqa: F401  (registers them)
from wavegym.systems.urban.system import Urban
from wavegym.systems.urban.tracker import Tracks, UrbanTracker

__all__ = ["Tracks", "Urban", "UrbanTracker"]
