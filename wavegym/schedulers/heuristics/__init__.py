"""Heuristics, which simulate no futures: index and price policies and cyclic schedules, for delayed costs."""
