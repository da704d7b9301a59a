"""Systems: the papers' closed loops, one a file; see ``wavegym.systems.contract`` for what a system is."""

from wavegym.systems.contract import Element, State, System

__all__ = ["Element", "State", "System"]
