"""The suite's own trained agents: experiments, leaderboard, headroom, board, distribution shift, demo.

A folder of the repository, not of the wheel. Training is in ``wavegym.learning``, trained policies are loaded by
``wavegym.policies``.
"""
