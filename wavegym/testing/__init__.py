"""Checks for anyone's environment and system."""

from __future__ import annotations

from wavegym.testing.check import ConformanceError, check_vector_env

__all__ = ["ConformanceError", "check_vector_env"]
