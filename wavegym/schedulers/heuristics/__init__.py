"""Rules that do not simulate futures: indices, prices and cyclic schedules, for systems with delayed costs."""
