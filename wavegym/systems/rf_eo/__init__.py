"""O'Rourke & Swindlehurst: platforms with a radar and a camera."""

from __future__ import annotations

from wavegym.systems.rf_eo import shortcuts  # noqa: F401  (registers them)
from wavegym.systems.rf_eo.system import RfEo

__all__ = ["RfEo"]
