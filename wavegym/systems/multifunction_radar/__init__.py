"""A multifunction radar: one agile beam tracks dozens of targets and searches for others, one dwell after another."""

from __future__ import annotations

from wavegym.systems.multifunction_radar import shortcuts  # noqa: F401  (registers them)
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

__all__ = ["MultifunctionRadar"]
