"""Episodes of two radars on one account of energy."""

from __future__ import annotations

import numpy as np
import oracles

from wavegym.systems.energy_budget.known import EnergyBudgetKnown
from wavegym.systems.energy_budget.system import EnergyBudget

BOTH = (EnergyBudget, EnergyBudgetKnown)


def states(system, worlds, choose):
    """States at k = 0, 1, ...; ``choose`` maps a belief to actions."""
    found = [system.initial(worlds)]
    for _ in range(system.horizon):
        found.append(system.transition(found[-1], choose(found[-1].belief), worlds))
    return found


def at_random(system, seed=0):
    rng = np.random.default_rng(seed)
    return lambda belief: rng.integers(len(system.actions), size=len(belief.step))


def beliefs(system, count=4, steps=(0, 5, 30)):
    """Beliefs of episodes in which little is spent, so that the account pays all actions from 0.27 a step."""
    rng = np.random.default_rng(1)
    played = states(system, oracles.worlds(system, count, 1), lambda p: rng.choice([0, 1, 4], size=len(p.step)))
    return [played[k].belief for k in steps]


def clear(kind):
    """Settings that make the first slots clear and the account large enough for their actions."""
    return {"windows": ((60, 71),), "budget": 0.27} if kind is EnergyBudgetKnown else {}
