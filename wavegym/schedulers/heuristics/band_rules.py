"""Rules for a radar that shares its band with other users, from the noise that it heard.

They need the shortcut ``sensed_band``. Channels count as occupied where their noise was above a threshold. A band is
clear if none of its channels was occupied.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.errors import check_int, check_non_negative, check_within
from wavegym.core.shortcuts import SensedBand, sensed_band
from wavegym.core.system import System
from wavegym.schedulers.heuristics.base import Heuristic


class BandRule(Heuristic):
    """Base class: the band of the greatest value."""

    needs = (sensed_band,)

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        super().begin(system, num_envs, rng)
        self._rng = rng

    @property
    def _band(self) -> SensedBand:
        """Looked up at each use: functions within functions cannot be sent to other processes."""
        return sensed_band(self.system)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        values = self.values(belief)
        if mask is not None:
            values = np.where(mask, values, -np.inf)
        return self.candidates[values.argmax(axis=1)]

    def values(self, belief: Any) -> Array:
        """The value of each band, (env, band)."""
        raise NotImplementedError

    def clear_widths(self, belief: Any, window: int) -> Array:
        """Channels of each band that was clear in the last ``window`` steps; 0 for others, (env, band)."""
        occupied = np.any(self._band.noise(belief, window) > self._band.busy, axis=1)
        is_clear = ~(occupied[:, None] & self._band.held).any(axis=2)
        return np.where(is_clear, self._band.held.sum(axis=1), 0)


class SenseAndAvoid(BandRule):
    """The widest band that was clear in the last step; the whole spectrum where there is none.

    The sense-and-avoid of Kirk, Martone and others has ``window`` = 1, ``keep`` = 0 and no limit of the width. With a
    larger ``keep`` it has hysteresis.

    Args:
        window: steps in which the band must have been clear.
        keep: the last band stays, while it is clear, unless another is wider by more channels than this.
        widest: channels of the widest band.

    Raises:
        InputError: a number out of range.
    """

    name = "sense-and-avoid"

    def __init__(self, window: int = 1, keep: int = 0, widest: int = 1000) -> None:
        self.window, self.widest = check_int("window", window, 1), check_int("widest", widest, 1)
        self.keep = check_int("keep", keep, 0)

    def values(self, belief: Any) -> Array:
        """See ``BandRule``."""
        width = self._band.held.sum(axis=1)
        values = self.clear_widths(belief, self.window).astype(np.float64)
        if self.keep:
            last = self._band.last(belief)
            rows = np.flatnonzero(last >= 0)
            stays = rows[self.clear_widths(belief, 1)[rows, last[rows]] > 0]
            values[stays, last[stays]] = width[last[stays]] + self.keep + 0.5
        return np.where(width > self.widest, -np.inf, values + 1e-6 * width)


class SenseAndHold(SenseAndAvoid):
    """``SenseAndAvoid`` with constants that are tuned."""

    name = "sense-and-hold"


class Claim(BandRule):
    """Takes a band and holds it, occupied or not, until it was occupied for ``patience`` steps: others may leave.

    The band is the one of at most ``width`` channels of the greatest score: its share of clear steps in the last
    ``window``, and its width over the number of bands.

    Args:
        width: channels of the band.
        patience: steps in succession after which an occupied band is given up, those before the claim included.
        window: steps from which a new band is chosen.

    Raises:
        InputError: a number out of range.
    """

    name = "claim"

    def __init__(self, width: int = 4, patience: int = 2, window: int = 4) -> None:
        self.width, self.patience = check_int("width", width, 1), check_int("patience", patience, 1)
        self.window = check_int("window", window, 1)

    def values(self, belief: Any) -> Array:
        """See ``BandRule``."""
        width = self._band.held.sum(axis=1)
        occupied = self._band.noise(belief, self.window) > self._band.busy
        clear = ~np.any(occupied[:, :, None] & self._band.held, axis=3)
        values = np.where(width <= self.width, clear.mean(axis=1) + width / len(width), 0.0)
        last = self._band.last(belief)
        rows = np.flatnonzero(last >= 0)
        heard = self._band.noise(belief, self.patience)[rows] > self._band.busy
        struck = np.any(heard & self._band.held[last[rows], None], axis=2)
        stays = rows[~struck.all(axis=1)]
        values[stays, last[stays]] = np.inf
        return values


class MultiObjective(BandRule):
    """The greatest weighted sum of log SINR and log bandwidth, in the mean noise of the last steps.

    Multi-objective spectrum sensing after A. F. Martone et al., IEEE Trans. Aerosp. Electron. Syst. 54(1), 2018.

    Args:
        weight: of the SINR, in [0, 1]; the rest is that of the bandwidth.
        window: steps over which the noise is averaged.

    Raises:
        InputError: a number out of range.
    """

    name = "multi-objective-sensing"

    def __init__(self, weight: float = 0.5, window: int = 1) -> None:
        self.weight, self.window = check_within("weight", weight, 0.0, 1.0), check_int("window", window, 1)

    def values(self, belief: Any) -> Array:
        """See ``BandRule``."""
        held = self._band.held / self._band.held.sum(axis=1, keepdims=True)
        noise = (np.nanmean(self._band.noise(belief, self.window), axis=1)[:, None] * held).sum(axis=2)
        return (1.0 - self.weight) * np.log(self._band.held.sum(axis=1)) - self.weight * np.log(noise)


class Bandit(BandRule):
    """Base class: one probability of each channel, whatever its order in time, from the steps that were occupied.

    Args:
        window: last steps that count.

    Raises:
        InputError: fewer than one step.
    """

    def __init__(self, window: int = 16) -> None:
        self.window = check_int("window", window, 1)

    def values(self, belief: Any) -> Array:
        """See ``BandRule``."""
        noise = self._band.noise(belief, self.window)
        on, steps = (noise > self._band.busy).sum(axis=1), (~np.isnan(noise)).sum(axis=1)
        return -self._band.cost(belief, self.probability(on, steps))

    def probability(self, on: Array, steps: Array) -> Array:
        """Of an occupied channel, from the number of occupied steps and of all that were heard, (env, channel)."""
        raise NotImplementedError


class Thompson(Bandit):
    """Thompson sampling: the probability is drawn from its Beta distribution, the prior's both numbers 1/2."""

    name = "thompson"

    def probability(self, on: Array, steps: Array) -> Array:
        """See ``Bandit``."""
        return self._rng.beta(on + 0.5, steps - on + 0.5)


class UpperConfidence(Bandit):
    """UCB: the least probability that is likely, the mean less ``optimism`` standard deviations.

    Args:
        optimism: standard deviations, >= 0.
        window: last steps that count.

    Raises:
        InputError: a number out of range.
    """

    name = "ucb"

    def __init__(self, optimism: float = 1.0, window: int = 16) -> None:
        super().__init__(window)
        self.optimism = check_non_negative("optimism", optimism)

    def probability(self, on: Array, steps: Array) -> Array:
        """See ``Bandit``."""
        mean = (on + 0.5) / (steps + 1.0)
        return np.clip(mean - self.optimism * np.sqrt(mean * (1.0 - mean) / (steps + 2.0)), 0.0, 1.0)
