"""Sira et al.: several targets in clutter, agile chirps at two sensors."""

from __future__ import annotations

from wavegym.systems.agile_clutter import shortcuts  # noqa: F401  (registers them)
from wavegym.systems.agile_clutter.system import AgileClutter

__all__ = ["AgileClutter"]
