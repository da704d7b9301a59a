"""A camera that takes time to slew."""

from __future__ import annotations

from wavegym.systems.camera_slew import shortcuts  # noqa: F401  (registers them)
from wavegym.systems.camera_slew.system import CameraSlew

__all__ = ["CameraSlew"]
