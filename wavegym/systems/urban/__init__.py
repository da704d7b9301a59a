"""Barbosa et al.: a multistatic radar in urban terrain."""

from __future__ import annotations

from wavegym.systems.urban.system import Urban

__all__ = ["Urban"]
