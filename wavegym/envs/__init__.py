"""Gymnasium environments of the systems."""

from __future__ import annotations

from wavegym.envs.rewards import Cost, LogCost, Relative, Reward, Scaled, SquaredGospa, Trace, Transition, TrueError
from wavegym.envs.single import WaveformEnv
from wavegym.envs.vector import WaveformVectorEnv

__all__ = [
    "Cost",
    "LogCost",
    "Relative",
    "Reward",
    "Scaled",
    "SquaredGospa",
    "Trace",
    "Transition",
    "TrueError",
    "WaveformEnv",
    "WaveformVectorEnv",
]
