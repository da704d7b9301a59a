"""What a transmitter and a receiver in a street measure of targets, by way of up to two walls, and of the street."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_within
from wavegym.sensors.checks import every, shaped
from wavegym.sensors.geometry import range_and_rate
from wavegym.sensors.multipath import Antenna
from wavegym.sensors.multipath_kernels import MOST_WALLS
from wavegym.sensors.receiver_kernels import path_delays
from wavegym.waveforms.fisher import SPEED_OF_LIGHT


def multistatic_range_and_rate(state: ArrayLike, transmitter: ArrayLike, receiver: ArrayLike) -> Array:
    """Half the way from transmitter to target to receiver, and its rate: what a delay and a Doppler shift say.

    Args:
        state: x = (x, y, xdot, ydot) in m and m/s, (..., 4).
        transmitter, receiver: positions (x, y) in m, (..., 2), of antennas or of their mirror images; leading axes
            broadcast.

    Returns:
        (r in m, rdot in m/s), (..., 2), positive when the way grows.

    Raises:
        InputError: shapes that do not fit.
    """
    return (range_and_rate(state, transmitter) + range_and_rate(state, receiver)) / 2.0


class Echoes(NamedTuple):
    """What comes back without a target: it does not move, and so is in the background."""

    r: Array  # half the way, m, (echo,)
    reflected: Array  # part of the power that walls leave, (echo,)
    source: Array  # from where it seems to come, (x, y) in m, (echo, 2)


@dataclass(frozen=True)
class Multistatic:
    """A transmitter, a receiver, and every way between them by one target and at most two walls.

    A way is a pair of images: one of the transmitter, as the target sees it, and one of the receiver.

    Args:
        transmitter, receiver: in one city.

    Raises:
        InputError: antennas in different cities.
    """

    transmitter: Antenna
    receiver: Antenna

    def __post_init__(self) -> None:
        if self.transmitter.city != self.receiver.city:
            raise InputError("transmitter and receiver stand in different cities, expected one city")

    @cached_property
    def ways(self) -> NDArray[np.int64]:
        """The images of transmitter and receiver of each way, (way, 2): the direct one first, then by walls' number."""
        out, back = self.transmitter.order, self.receiver.order
        walls = out[:, None] + back
        pairs = np.argwhere(walls <= MOST_WALLS)
        return pairs[np.argsort(walls[walls <= MOST_WALLS], kind="stable")]

    @cached_property
    def walls(self) -> NDArray[np.int64]:
        """How many walls each way takes, (way,)."""
        return np.asarray(self.transmitter.order[self.ways[:, 0]] + self.receiver.order[self.ways[:, 1]])

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Each way in the paper's words, T transmitter, X target, C wall, R receiver: ``"TXR"``, ``"TXCR"``, ..."""
        out, back = self.transmitter.order[self.ways[:, 0]], self.receiver.order[self.ways[:, 1]]
        return tuple(f"T{'C' * o}X{'C' * b}R" for o, b in zip(out.tolist(), back.tolist(), strict=True))

    @cached_property
    def reflected(self) -> Array:
        """Part of the power that is left after each way's walls, (way,)."""
        return np.asarray(
            self.transmitter.reflected[self.ways[:, 0]] * self.receiver.reflected[self.ways[:, 1]], np.float64
        )

    def open(self, points: ArrayLike) -> NDArray[np.bool_]:
        """By which ways a target at points (x, y) in m, (..., 2), returns anything, (..., way)."""
        out, back = self.transmitter.seen(points), self.receiver.seen(points)
        return out[..., self.ways[:, 0]] & back[..., self.ways[:, 1]]

    def measure(self, state: ArrayLike) -> Array:
        """(r in m, rdot in m/s) by every way, open or not, of x = (x, y, xdot, ydot), (..., 4): (..., way, 2)."""
        state = shaped("state", state, 4)[..., None, :]
        images = self.transmitter.images[self.ways[:, 0]], self.receiver.images[self.ways[:, 1]]
        return multistatic_range_and_rate(state, *images)

    def delays(self, state: ArrayLike, way: ArrayLike, times: ArrayLike, offsets: ArrayLike) -> Array:
        """Time that each way takes at each element of the receiver while the target moves on, s, (n, time, element).

        Doppler shift, direction and its rate are all in it: the phase of an echo is -2 pi fc times this.

        Args:
            state: x = (x, y, xdot, ydot, xddot, yddot), SI units, (n, 6).
            way: number of the way of each, (n,).
            times: after which the target is looked at again, at constant acceleration, s, (time,).
            offsets: of the elements along the receiver's axis, m, (element,).

        Raises:
            InputError: shapes that do not fit, a way that is none.
        """
        state, way = shaped("state", state, 6), np.asarray(way)
        if state.ndim != 2 or way.shape != state.shape[:1]:
            raise InputError(f"state and way have shapes {state.shape} and {way.shape}, expected (n, 6) and (n,)")
        every(lambda name, number: check_within(name, number, 0, len(self.ways) - 1), "way", way)
        if (way != np.floor(way)).any():
            raise InputError(f"way is {way.tolist()}, expected integers")
        times, offsets = np.array(times, np.float64, ndmin=1), np.array(offsets, np.float64, ndmin=1)
        if times.ndim > 1 or offsets.ndim > 1:
            raise InputError(f"times and offsets have shapes {times.shape} and {offsets.shape}, expected one axis each")
        out, back = self.ways[way.astype(np.int64)].T
        delays = np.empty((len(way), len(times), len(offsets)))
        images = self.transmitter.images[out], self.receiver.images[back], self.receiver.axes[back]
        path_delays(np.array(state, order="C"), *images, offsets, times, SPEED_OF_LIGHT, delays)
        return delays

    def background(self) -> Echoes:
        """Ways without a target: by one wall (TCR), two (TCCR), or one of the things that scatter (TCR)."""
        mirrors = self.transmitter.seen(self.receiver.position) & (self.transmitter.order > 0)
        length = np.linalg.norm(self.transmitter.images - np.array(self.receiver.position), axis=1)
        things = np.array(self.transmitter.city.discretes, np.float64).reshape(-1, 2)
        lit = self.transmitter.seen(things)[:, 0] & self.receiver.seen(things)[:, 0]
        still = np.concatenate([things, np.zeros_like(things)], axis=1)
        scattered = multistatic_range_and_rate(still, self.transmitter.position, self.receiver.position)[:, 0]
        r = np.concatenate([length[mirrors] / 2.0, scattered[lit]])
        reflected = np.concatenate([self.transmitter.reflected[mirrors], np.ones(lit.sum())])
        return Echoes(r, reflected, np.concatenate([self.transmitter.images[mirrors], things[lit]]))
