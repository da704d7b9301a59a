"""Frames for one beam on a time line: the dwells of the next frame are chosen together."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.shortcuts import gain_per_second
from wavegym.core.system import System
from wavegym.schedulers.heuristics.base import greatest
from wavegym.schedulers.heuristics.timeline_rules import TimelineRule


class FrameGreedy(TimelineRule):
    """Allot the time of a frame by the greatest marginal gain per second, then execute the dwells (as Q-RAM does).

    A task is the update of a track or the search of a sector, and gets at most one dwell of a frame. The allotment
    starts without dwells. It repeatedly lengthens the dwell with the greatest gain per added second, until the frame is
    full. The dwells are then executed in order of falling gain per second. See Rajkumar, Lee, Lehoczky and Siewiorek
    (1997), and Ghosh, Rajkumar, Hansen and Lehoczky (2004) for a radar.

    Args:
        ahead, worth: see ``GainPerSecond``.
        frame: length of a frame, s.
    """

    name = "frame-greedy"

    def __init__(self, ahead: float, worth: float, frame: float) -> None:
        self.ahead, self.worth, self.frame = ahead, worth, frame

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``."""
        super().begin(system, num_envs, rng)
        self.left = np.zeros((num_envs, len(self.durations)), np.bool_)  # dwells of the frame that are still to do
        self.end = np.zeros(num_envs)

    def choose(self, belief: Any, mask: Array | None, prepared: Array | None) -> Array:
        """See ``Heuristic``."""
        gain = gain_per_second(self.system, belief, self.ahead, self.worth)
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
