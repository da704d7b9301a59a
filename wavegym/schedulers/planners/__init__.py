"""Planners: they simulate futures with sampled outcomes and leave their base policy only for a significant gain."""

from wavegym.schedulers.planners.base import Planner
from wavegym.schedulers.planners.mcts import MonteCarloTree
from wavegym.schedulers.planners.receding_horizon import PlanOnce, RecedingHorizon
from wavegym.schedulers.planners.rollout import BeamSearch, RolloutPlanner, TreeSearch

__all__ = ["BeamSearch", "MonteCarloTree", "PlanOnce", "Planner", "RecedingHorizon", "RolloutPlanner", "TreeSearch"]
