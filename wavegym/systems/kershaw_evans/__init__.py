"""Kershaw & Evans (1994): one target on a line of sight, Gaussian chirps."""

from __future__ import annotations

from wavegym.systems.kershaw_evans import shortcuts  # noqa: F401  (registers them)
from wavegym.systems.kershaw_evans.system import KershawEvans, KershawEvansPosition

__all__ = ["KershawEvans", "KershawEvansPosition"]
