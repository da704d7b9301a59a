"""Constants that a policy needs, found on worlds that are for tuning and never on those of the test."""

from __future__ import annotations

from typing import Any

import numpy as np
from tqdm import tqdm

from wavegym.schedulers.rollout import rollout
from wavegym.schedulers.simple import Fixed
from wavegym.systems.contract import System


def best_fixed(system: System, worlds: Any) -> int:
    """The constant that costs least when it is all that is ever transmitted; the first of equals.

    Each one is played on all worlds as one batch and one after another, so no more than one rollout is in memory.

    Args:
        system: the closed loop.
        worlds: tapes for tuning, axis 0 = world.

    Returns:
        Index into ``system.constants()``.
    """
    constants = tqdm(range(len(system.constants())), "tuning best-fixed", disable=None, leave=False)
    means = np.array([rollout(system, Fixed(k), worlds).mean_cost.mean() for k in constants])
    return int(np.argmin(np.where(np.isnan(means), np.inf, means)))
