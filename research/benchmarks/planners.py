"""Planners: time and peak memory per decision; the memory must not grow with the depth or the batch."""

from __future__ import annotations

import tracemalloc
from typing import NamedTuple

import numpy as np

from research.benchmarks.timing import cpu_us
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.core.worlds import draw_worlds, world_seeds
from wavegym.schedulers import Fixed, Lookahead, Myopic
from wavegym.schedulers.heuristics.price_policies import LagrangianPrice
from wavegym.schedulers.planners import RolloutPlanner
from wavegym.systems.camera_slew.system import CameraSlew
from wavegym.systems.energy_budget.system import EnergyBudget
from wavegym.systems.kershaw_evans.system import KershawEvansPosition
from wavegym.systems.sector_setup.system import SectorSetup


class Decision(NamedTuple):
    """Time and memory of one decision."""

    batch: int
    cpu_us: float
    peak_mib: float  # Python allocations during the decision


def measure(policy: Policy, batch: int, system: System | None = None) -> Decision:
    """CPU time and peak memory per decision of a batch."""
    system = system or KershawEvansPosition()
    belief = system.initial(draw_worlds(system, world_seeds(0, "test", batch))).belief
    policy.begin(system, batch, np.random.default_rng(0))
    policy.act(belief, None, None)

    def act() -> int:
        policy.act(belief, None, None)
        return batch

    cost = cpu_us(act)
    tracemalloc.start()
    act()
    peak = tracemalloc.get_traced_memory()[1] / 2**20
    tracemalloc.stop()
    return Decision(batch, cost, peak)


def run() -> dict[str, list[Decision]]:
    """All planners at three batch sizes."""
    policies = {
        "myopic": Myopic(),
        "lookahead:2, fused": Lookahead(2),
        "lookahead:3, fused": Lookahead(3),
        "lookahead:2, by predict": Lookahead(2, fused=False),
    }
    return {name: [measure(policy, batch) for batch in (1, 64, 512)] for name, policy in policies.items()}


def rollouts() -> dict[str, list[Decision]]:
    """Rollouts of at most 16 candidates for 10 steps in one sampled future; most bases ignore the belief."""
    named: dict[str, tuple[System, Policy]] = {
        "KershawEvansPosition, 16 candidates of 56": (KershawEvansPosition(), Fixed(0)),
        "CameraSlew, 4 candidates": (CameraSlew(), Fixed(0)),
        "SectorSetup, 8 candidates": (SectorSetup(), Fixed(0)),
        "EnergyBudget, 16 candidates": (EnergyBudget(), Fixed(0)),
        "EnergyBudget, 16 candidates, on `lagrangian-price`": (EnergyBudget(), LagrangianPrice(1e3, 8)),
    }
    return {
        f"rollout:10, {name}": [
            measure(RolloutPlanner(base, 10, futures=1, shortlist=16), batch, system) for batch in (1, 64)
        ]
        for name, (system, base) in named.items()
    }
