"""Opponents that no radar could be: they know the other users. References for schedulers, not schedulers."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_int
from wavegym.core.system import System
from wavegym.systems.shared_spectrum.kernels import BUSY_NOISE
from wavegym.systems.shared_spectrum.shortcuts import least_cost
from wavegym.systems.shared_spectrum.state import Belief, Truth
from wavegym.systems.shared_spectrum.system import SharedSpectrum


class Clairvoyant:
    """The band of least expected cost in the next train's noise, which it knows. No bound: it looks one step ahead.

    It follows the truth of its own actions from the revealed worlds.
    """

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError for another system."""
        if not isinstance(system, SharedSpectrum):
            raise InputError(f"{type(self).__name__} was given {type(system).__name__}, expected a SharedSpectrum")
        self._system, self._rng = system, rng

    def reveal(self, world: Any) -> None:
        """See ``wavegym.core.policy.Clairvoyant``."""
        self._world, self._truth = world, self._system.initial(world).truth

    def act(self, belief: Belief, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``. After the end of an episode the action is arbitrary."""
        step = np.minimum(belief.step, self._system.horizon - 1)
        band = self.costs(belief, step).argmin(axis=1)
        moved = self._system.move(self._truth, step, self._world)
        first = self._system.bands.first[band]
        taken = np.stack([first, first + self._system.bands.width[band]], axis=1)
        self._truth = moved._replace(taken=taken)
        action: Array = self._system.candidates()[band]
        return action

    def costs(self, belief: Belief, step: Array) -> Array:
        """Expected cost of each band, (env, band)."""
        return self.known_costs(belief, self._system.move(self._truth, step, self._world).noise)

    def known_costs(self, belief: Belief, noise: Array) -> Array:
        """Expected cost of each band in this noise (env, channel), (env, band)."""
        occupied = (noise >= BUSY_NOISE).astype(np.float64)
        return least_cost(self._system, belief, np.ones_like(noise), noise, occupied)


class Informed(Clairvoyant):
    """As ``Clairvoyant``, but it knows the users' kinds, parameters and places, not their random choices.

    The cost of a band is the mean over ``futures`` next occupancies.

    Args:
        futures: draws of the users' next choices.

    Raises:
        InputError: fewer than one.
    """

    def __init__(self, futures: int = 16) -> None:
        self.futures = check_int("futures", futures, 1)

    def costs(self, belief: Belief, step: Array) -> Array:
        """See ``Clairvoyant``."""
        many: Truth = trees.repeated(self._truth, self.futures)
        world, steps = trees.repeated(self._world, self.futures), step.repeat(self.futures)
        keys = self._rng.integers(2**64, size=world.key.shape, dtype=np.uint64)
        noise = self._system.move(many, steps, world._replace(key=keys)).noise
        each = self.known_costs(trees.repeated(belief, self.futures), noise)
        mean: Array = each.reshape(len(step), self.futures, -1).mean(axis=1)
        return mean
