"""World, truth and belief of the multifunction radar."""

from __future__ import annotations

from typing import NamedTuple

from wavegym.core.arrays import Array


class World(NamedTuple):
    """All random numbers of an episode."""

    key: Array  # (env,) uint64: of manoeuvres and of dwells
    draw: Array  # (env, target, 7) uniform: gap between arrivals, place (2), heading, speed, mode, whether it is known
    error: Array  # (env, target, 4) standard normal: of the first estimates


class Truth(NamedTuple):
    """The true targets, and figures that were taken last; g targets, k slots."""

    state: Array  # (env, g, 4) [x xdot y ydot], m, m/s, at the beginning of the cell
    mode: Array  # (env, g) int
    here: Array  # (env, g) bool
    cell: Array  # (env,) int, cells of time that have begun
    origin: Array  # (env, k) int, the target whose echo a slot has used last; -1: a false alarm
    arrival: Array  # (env, g) s, negative for those that are there at the beginning
    held: Array  # (env, g) bool, whether a confirmed track followed the target when the figures were taken
    confirmed: Array  # (env, g) s, when the target had its first confirmed track; NaN before
    lost: Array  # (env,) targets whose confirmed track was lost while they were there, so far
    false: Array  # (env,) confirmed tracks of no target
    gospa: Array  # (env,) m
    squared_error: Array  # (env, k) m^2
    variance: Array  # (env, k) m^2
    nees: Array  # (env, k)
    replaced: Array  # (env,) bool, whether the last action was the update of a free slot, which is a wait
    present: Array  # (env, k) bool, whether a slot's track is confirmed and of a target that is there


class Belief(NamedTuple):
    """The tracks, as they were at their last update, and the undetected; k slots, m modes, s sectors, b range bins."""

    step: Array  # (env,) int
    time: Array  # (env,) s
    updated: Array  # (env, k) s, time of the last update
    mean: Array  # (env, k, m, 4) [x xdot y ydot], m, m/s
    covariance: Array  # (env, k, m, 4, 4)
    probability: Array  # (env, k, m) of the modes
    existence: Array  # (env, k); 0: the slot is free
    moments: Array  # (env, k, 10), see ``Slots``
    undetected: Array  # (env, s, b) expected number of targets without a track
    turn: Array  # (env, s) int, the next beam of each sector
    spent: Array  # (env,) m^2 s, the cost of the last dwell
    duration: Array  # (env,) s, of the last dwell
