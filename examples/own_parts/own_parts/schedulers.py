"""A scheduler that takes the first action whose predicted cost is nearly the least."""

import numpy as np


class FirstGood:
    """The first candidate whose predicted cost is within ``slack`` of the least one.

    Args:
        slack: share of the least cost; 0 for the one-step scheduler.
    """

    def __init__(self, slack=0.05):
        self.slack = slack

    def begin(self, system, num_envs, rng):
        """Called once for a batch of fresh episodes."""
        self.system, self.candidates = system, system.candidates()

    def act(self, belief, observation, mask):
        """Actions (env, ...) of a belief, whose arrays are (env, ...)."""
        costs = self.system.cost(self.system.predict(belief, self.candidates[None]))  # (env, candidate)
        if mask is not None:
            costs = np.where(mask, costs, np.inf)
        is_good = costs <= (1.0 + self.slack) * costs.min(axis=1, keepdims=True)
        return self.candidates[is_good.argmax(axis=1)]


def first_good(system, tuning_worlds):
    """The scheduler for a system. Its slack is not tuned, so the worlds for tuning are not used."""
    return FirstGood()
