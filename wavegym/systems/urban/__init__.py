"""A multistatic radar in urban terrain (Barbosa et al.)."""

from __future__ import annotations

from wavegym.systems.urban import shortcuts  # noqa: F401  (registers them)
from wavegym.systems.urban.system import Urban

__all__ = ["Urban"]
