"""Checks for environments and systems, the suite's or your own."""

from __future__ import annotations

from wavegym.testing.check import ConformanceError, check_vector_env

__all__ = ["ConformanceError", "check_vector_env"]
