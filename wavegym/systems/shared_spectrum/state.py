"""A target on the line of sight and the other users of the band: tape, truth, belief and what a step reports."""

from __future__ import annotations

from typing import Any, NamedTuple

from wavegym.core.arrays import Array


class World(NamedTuple):
    """One episode's tape."""

    start: Array  # (2,) uniform: first range and range-rate
    normal: Array  # (H + 1, 4): manoeuvre (2) and measurement error (2) of a step; row 0: error of the first estimate
    sensing: Array  # (S + H, c) normal: errors of the measured noise, from the first step of listening on
    kind: Array  # (u, 9) uniform: parameters of the users
    key: Array  # (3,) uint64: of the users' choices, of the echoes, and of a user's own kinds of users


class Truth(NamedTuple):
    """The part of the state that no scheduler sees."""

    targets: Array  # (env, 2) range and range-rate
    path: Array  # (env, H + 1, 2) the truth at every step; no choice changes it
    users: Array  # (env, u, 7); see ``user_kernels``
    places: Array  # (env, u, 4); see ``user_kernels``
    own: tuple[Any, ...]  # of each user of one's own: its state, and its noise (env, c)
    taken: Array  # (env, 2) int: first channel of the radar's last band, and the one above it; 0, 0: none
    noise: Array  # (env, c) in the last train, in units of the receiver's noise
    late: Array  # (env, delay, c) measured noise that the scheduler does not know yet, the latest first
    collisions: Array  # (env,) users that the last band overlapped


class Measurements(NamedTuple):
    """What the receiver reports of one train."""

    present: Array  # (env,) bool: the target was detected
    z: Array  # (env, 2) range and range-rate
    noise: Array  # (env, c) measured in the gaps of the train
    known: Array  # (env, c) measured ``sensing_delay`` steps ago: what the scheduler learns now
    band: Array  # (env,) int: that of the train


class Belief(NamedTuple):
    """What the radar knows. S steps of listening come before the first train; c channels.

    Row S + step - 1 - ``sensing_delay`` of ``heard`` is the last one that is known; later rows are 0. The shortcut
    ``sensed_band`` reads them as a ratio of powers.
    """

    step: Array  # (env,) int, trains so far
    mean: Array  # (env, 2) range in m and range-rate in m/s
    covariance: Array  # (env, 2, 2)
    heard: Array  # (env, S + H, c) uint8: measured noise over the receiver's, in half decibels, rounded and at least 0
    sent: Array  # (env, H) int16: index of the band of each train; -1: none yet
    level: Array  # (env, c) running mean of the noise in a channel while it was occupied, in the receiver's noise
    struck: Array  # (env,) occupied channels in the last band, as the radar heard or predicted them
