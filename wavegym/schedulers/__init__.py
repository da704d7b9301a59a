"""Schedulers: analytic policies that choose the next waveform; learned policies share their protocol."""

from wavegym.schedulers.lookahead import Lookahead
from wavegym.schedulers.myopic import Myopic
from wavegym.schedulers.policy import Policy
from wavegym.schedulers.rollout import Rollout, rollout
from wavegym.schedulers.simple import Fixed, RandomChoice, RoundRobin

__all__ = ["Fixed", "Lookahead", "Myopic", "Policy", "RandomChoice", "Rollout", "RoundRobin", "rollout"]
