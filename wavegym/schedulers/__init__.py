"""Schedulers: analytic policies that choose the next waveform. Learned policies have the same protocol."""

from wavegym.core.policy import Policy
from wavegym.schedulers.closed_form import MyopicClosedForm
from wavegym.schedulers.constrained import Continuous, InfeasibleThreshold, MyopicInformation
from wavegym.schedulers.lookahead import Lookahead
from wavegym.schedulers.myopic import Myopic, Progressive
from wavegym.schedulers.optimum import Optimum, Schedule, best_schedule
from wavegym.schedulers.rollout import Rollout, rollout
from wavegym.schedulers.simple import Cycle, Fixed, RandomChoice, RoundRobin

__all__ = [
    "Continuous",
    "Cycle",
    "Fixed",
    "InfeasibleThreshold",
    "Lookahead",
    "Myopic",
    "MyopicClosedForm",
    "MyopicInformation",
    "Optimum",
    "Policy",
    "Progressive",
    "RandomChoice",
    "Rollout",
    "RoundRobin",
    "Schedule",
    "best_schedule",
    "rollout",
]
