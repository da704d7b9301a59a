"""Rules for one beam on a time line: which track to update next, or which sector to search.

They are for systems with the traits ``UnequalSteps`` and ``TrackSlots``. All choose among tracks by the belief about
each slot. A track with existence probability below ``CONFIRMED`` is tentative.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.shortcuts import Shortcut, gain_per_second, scores, simulate
from wavegym.core.system import System
from wavegym.core.traits import CONFIRMED, DwellRule, TrackSlots, UnequalSteps
from wavegym.schedulers.heuristics.base import Heuristic, greatest

EXISTENCE, POINTING, POSITION, AGE, SNR = 0, 3, 4, 6, 8  # columns of ``slots_now``


class TimelineRule(Heuristic):
    """Base class of the rules."""

    needs: tuple[Shortcut[..., Any] | type, ...] = (UnequalSteps, TrackSlots, gain_per_second)

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        super().begin(system, num_envs, rng)
        self.dwells = self.system.dwells
        self.durations = self.dwells.menu[3]

    def most_urgent(self, urgency: Array, dwell: Array | int, otherwise: Array) -> Array:
        """Updates of the slots of the greatest urgency (env, slot) where it is 0 or more; else ``otherwise`` (env,).

        dwell: of each slot's update, (env, slot), or one for all.
        """
        slot, rows = urgency.argmax(axis=1), np.arange(len(urgency))
        dwells = np.broadcast_to(dwell, urgency.shape)
        update: Array = self.dwells.update(slot, dwells[rows, slot])
        return np.where(urgency[rows, slot] >= 0.0, update, otherwise)

    def most_promising_search(self, belief: Any, dwell: int) -> Array:
        """Searches, with one dwell, of the sectors with the most expected detections per second, (env,)."""
        searches = self.dwells.search(np.arange(self.dwells.sectors), dwell)
        gain = gain_per_second(self.system, belief)[:, searches]
        return searches[gain.argmax(axis=1)]


class RoundRobinSearch(TimelineRule):
    """The oldest track and the next sector in turn, a fixed share of the dwells for the search.

    Args:
        share: of the dwells for the search, in (0, 1].
        update: number of the dwell of an update.
        search: number of the dwell of a search.
    """

    name = "round-robin-search"

    def __init__(self, share: float, update: int, search: int) -> None:
        self.share, self.update, self.search = share, update, search

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        rows = self.system.slots_now(belief)
        before = np.floor(belief.step * self.share)
        is_search = np.floor((belief.step + 1) * self.share) > before
        sector = before.astype(np.int64) % self.dwells.sectors
        age = np.where((rows[..., EXISTENCE] > 0.0) & ~is_search[:, None], rows[..., AGE], -1.0)
        return self.most_urgent(age, self.update, self.dwells.search(sector, self.search))


class EarliestDeadline(TimelineRule):
    """Update the track that is most overdue; search if none is overdue. Deadlines count from the last update.

    Args:
        revisit: seconds from the last update to the deadline of a confirmed track.
        confirm: seconds until a tentative track is due.
        update: number of the dwell of an update.
        search: number of the dwell of a search.
    """

    name = "earliest-deadline"

    def __init__(self, revisit: float, confirm: float, update: int, search: int) -> None:
        self.revisit, self.confirm, self.update, self.search = revisit, confirm, update, search

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        rows = self.system.slots_now(belief)
        interval = np.where(rows[..., EXISTENCE] < CONFIRMED, self.confirm, self.revisit)
        late = np.where(rows[..., EXISTENCE] > 0.0, rows[..., AGE] - interval, -np.inf)
        return self.most_urgent(late, self.update, self.most_promising_search(belief, self.search))


class VanKeukBlackman(TimelineRule):
    """Update a track when the standard deviation of its azimuth reaches a share of the beam width.

    The dwell is the shortest that gives an expected SNR, so near targets get short dwells. van Keuk and Blackman (1993)
    find a share of 0.3 and an SNR of about 16 dB the cheapest. Here both are tuned, and so is the time until the next
    update of a tentative track.

    Args:
        pointing: standard deviation of the azimuth, in beam widths, at which a track is updated.
        snr: least expected E/N0 of an update.
        confirm: seconds until a tentative track is due.
        search: number of the dwell of a search.
    """

    name = "van-keuk-blackman"

    def __init__(self, pointing: float, snr: float, confirm: float, search: int) -> None:
        self.pointing, self.snr, self.confirm, self.search = pointing, snr, confirm, search

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        rows = self.system.slots_now(belief)
        existence = rows[..., EXISTENCE]
        due = np.where(existence < CONFIRMED, rows[..., AGE] - self.confirm, rows[..., POINTING] - self.pointing)
        due = np.where(existence > 0.0, due, -np.inf)
        seconds = np.array(self.dwells.seconds)
        too_weak = rows[..., SNR, None] * seconds[:-1] < self.snr
        return self.most_urgent(due, too_weak.sum(axis=-1), self.most_promising_search(belief, self.search))


class GainPerSecond(TimelineRule):
    """The dwell that saves most per second of its duration, until its effect has worn off.

    Args:
        worth, power: of a find, which is worth ``worth`` times its value to this power.
    """

    name = "gain-per-second"

    def __init__(self, worth: float, power: float) -> None:
        self.worth, self.power = worth, power

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        return greatest(gain_per_second(self.system, belief, self.worth, self.power), mask, self.durations)


class PriceOfTime(TimelineRule):
    """The dwell with the greatest gain minus the price of its time; if all are negative, the greatest ratio of the two.

    The price is the Lagrange multiplier of the time line, found by simulation. Unused time is lost, so the rule never
    waits because of a high price.

    Args:
        worth, power: see ``GainPerSecond``.
        price: of a second, in the cost of one undetected target.
    """

    name = "price-of-time"

    def __init__(self, worth: float, power: float, price: float) -> None:
        self.worth, self.power, self.price = worth, power, price

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        surplus = gain_per_second(self.system, belief, self.worth, self.power) - self.price * self.system.c0
        allowed = surplus if mask is None else np.where(mask, surplus, -np.inf)
        is_worth_it = allowed.max(axis=1, keepdims=True) > 0.0
        return greatest(np.where(is_worth_it, surplus * self.durations, surplus), mask, self.durations)


class DelayIndex(TimelineRule):
    """The dwell that loses most by a delay: gain per second now minus a share of the gain per second after the delay.

    Args:
        worth, power: see ``GainPerSecond``.
        later: the delay, s.
        kappa: that share.
    """

    name = "delay-index"

    def __init__(self, worth: float, power: float, later: float, kappa: float) -> None:
        self.worth, self.power, self.later, self.kappa = worth, power, later, kappa

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        now = gain_per_second(self.system, belief, self.worth, self.power)
        then = gain_per_second(self.system, belief._replace(time=belief.time + self.later), self.worth, self.power)
        return greatest(now - self.kappa * then, mask, self.durations)


class SearchedDwell(TimelineRule):
    """The dwell of the greatest score of a ``DwellRule``, whose constants CMA-ES finds on fresh worlds."""

    name = "searched-dwell"
    needs = (*TimelineRule.needs, scores, simulate)

    def __init__(self, **constants: float) -> None:
        self.rule = DwellRule(**constants)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        return greatest(scores(self.system, belief, self.rule), mask, self.durations)


class FrameGreedy(TimelineRule):
    """Allot the time of a frame by the greatest marginal gain per second, then execute the dwells (as Q-RAM does).

    A task is the update of a track or the search of a sector, and gets at most one dwell of a frame. The allotment
    starts without dwells. It repeatedly lengthens the dwell with the greatest gain per added second, until the frame is
    full. The dwells are then executed in order of falling gain per second. See Rajkumar, Lee, Lehoczky and Siewiorek
    (1997), and Ghosh, Rajkumar, Hansen and Lehoczky (2004) for a radar.

    Args:
        worth, power: see ``GainPerSecond``.
        frame: length of a frame, s.
    """

    name = "frame-greedy"

    def __init__(self, worth: float, power: float, frame: float) -> None:
        self.worth, self.power, self.frame = worth, power, frame

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        super().begin(system, num_envs, rng)
        self.left = np.zeros((num_envs, len(self.durations)), np.bool_)  # dwells of the frame that are still to do
        self.end = np.zeros(num_envs)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        gain = gain_per_second(self.system, belief, self.worth, self.power)
        possible = np.ones(gain.shape, np.bool_) if mask is None else mask
        self.left &= possible
        for e in np.flatnonzero(~self.left.any(axis=1) | (belief.time >= self.end) | (belief.step == 0)):
            self.left[e] = self.allotted(gain[e] * self.durations * possible[e])
            self.end[e] = belief.time[e] + self.frame
        rows = np.arange(len(gain))
        # An update's gain grows while it waits, so the order is found anew.
        action = greatest(gain, np.where(self.left.any(axis=1, keepdims=True), self.left, possible), self.durations)
        self.left[rows, action] = False
        return action

    def allotted(self, worth: Array) -> Array:
        """Which dwells the frame has, (action,) bool, where ``worth`` (action,) is the gain of each."""
        each = self.dwells.each
        worth, seconds = worth[:-1].reshape(-1, each), self.durations[:each]
        got, used, level = np.zeros(len(worth)), np.zeros(len(worth)), np.full(len(worth), -1)
        while True:
            more = np.where(seconds > used[:, None], seconds - used[:, None], np.inf)
            rate = (worth - got[:, None]) / more
            task, dwell = np.unravel_index(rate.argmax(), rate.shape)
            if rate[task, dwell] <= 0.0 or used.sum() + more[task, dwell] > self.frame:
                break
            got[task], used[task], level[task] = worth[task, dwell], seconds[dwell], dwell
        done = np.zeros(worth.shape, np.bool_)
        tasks = np.flatnonzero(level >= 0)
        done[tasks, level[tasks]] = True
        return np.append(done.reshape(-1), False)
