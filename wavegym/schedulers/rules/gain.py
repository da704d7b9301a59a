"""Moves to wavegym.systems.costs; removed when nobody imports it from here."""

from wavegym.systems.costs import horizon_weights

__all__ = ["horizon_weights"]
