"""A radar that shares its band with other users."""

from __future__ import annotations

from wavegym.systems.shared_spectrum import shortcuts  # noqa: F401  (registers them)
from wavegym.systems.shared_spectrum.system import SharedSpectrum

__all__ = ["SharedSpectrum"]
