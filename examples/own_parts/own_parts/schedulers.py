"""A scheduler that looks ahead at every other step only."""

import numpy as np

from wavegym.schedulers import Myopic


class EveryOther:
    """The one-step choice at even steps; at odd steps the last action again.

    Args:
        inner: the scheduler of the even steps.
    """

    def __init__(self, inner):
        self.inner = inner

    def begin(self, system, num_envs, rng):
        """Called once for a batch of fresh episodes."""
        self.inner.begin(system, num_envs, rng)
        self.last = None

    def act(self, belief, observation, mask):
        """Actions (env, ...). ``belief.step`` is (env,) int."""
        fresh = self.inner.act(belief, observation, mask)
        if self.last is None:
            self.last = fresh
        is_even = (belief.step % 2 == 0).reshape(-1, *(1,) * (fresh.ndim - 1))
        self.last = np.where(is_even, fresh, self.last)
        return self.last


def every_other(system, tuning_worlds):
    """The scheduler for a system. It has no constants, so it does not use the worlds for tuning."""
    return EveryOther(Myopic())
