"""Range and range-rate in the plane, of one sensor or of a transmitter and a receiver, and the echoes in an urban map.

Echoes of targets arrive over up to two walls; static echoes come from walls and small scatterers.

Multilateration gives position and velocity of a new track from one scan of two receivers. Barbosa et al., section
4.2.1, take differences of two scans. Range and range-rate at one receiver give no direction, so two receivers are
needed. Two positions remain; the caller chooses one with the road map.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import (
    Array,
    FloatArray,
    check_elements,
    check_finite,
    check_last_axes,
    checked_copy,
    flatten_lead,
)
from wavegym.core.covariances import check_covariance
from wavegym.core.errors import InputError, check_within
from wavegym.sensors import geometry_kernels as kernels
from wavegym.sensors.multipath import Antenna
from wavegym.sensors.multipath_kernels import MOST_WALLS
from wavegym.sensors.receiver_kernels import path_delays
from wavegym.waveforms.fisher import SPEED_OF_LIGHT


def range_and_rate(state: ArrayLike, sensor: ArrayLike) -> Array:
    """h(x) = (r, rdot): r = |p - s| and rdot = v'(p - s) / r, positive when the target recedes.

    Args:
        state: x = (x, y, xdot, ydot) in m and m/s, (..., 4).
        sensor: position s = (x, y) in m, (..., 2); leading axes broadcast with those of ``state``.

    Returns:
        (r in m, rdot in m/s), (..., 2). r is at least 1e-9 m. At the sensor itself, where no direction is defined, rdot
        is 0.

    Raises:
        InputError: shapes that do not fit, or numbers that are not finite.
    """
    return kernels.measure(check_finite("state", state, 4), check_finite("sensor", sensor, 2))


def range_and_rate_jacobian(state: ArrayLike, sensor: ArrayLike) -> Array:
    """H = dh/dx of ``range_and_rate``, (..., 2, 4): rows r, rdot; columns x, y, xdot, ydot. Same arguments."""
    return kernels.jacobian(check_finite("state", state, 4), check_finite("sensor", sensor, 2))


def multistatic_range_and_rate(state: ArrayLike, transmitter: ArrayLike, receiver: ArrayLike) -> Array:
    """Half the path length from transmitter by target to receiver, and its rate, as delay and Doppler shift give them.

    Args:
        state: x = (x, y, xdot, ydot) in m and m/s, (..., 4).
        transmitter, receiver: positions (x, y) in m, (..., 2), of antennas or of their mirror images; leading axes
            broadcast.

    Returns:
        (r in m, rdot in m/s), (..., 2), positive rate for a growing path.

    Raises:
        InputError: a wrong shape, or numbers that are not finite.
    """
    ends = check_finite("transmitter", transmitter, 2), check_finite("receiver", receiver, 2)
    return (range_and_rate(state, ends[0]) + range_and_rate(state, ends[1])) / 2.0


class Echoes(NamedTuple):
    """Static echoes, without a target: the background."""

    r: Array  # half the path length, m, (echo,)
    reflected: Array  # fraction of the power left after the walls, (echo,)
    source: Array  # apparent source, (x, y) in m, (echo, 2)


@dataclass(frozen=True)
class Multistatic:
    """A transmitter, a receiver, and all propagation paths between them by one target and at most two walls.

    A path is a pair of images: one of the transmitter and one of the receiver.

    Args:
        transmitter, receiver: antennas in the same urban map.

    Raises:
        InputError: antennas in different maps.
    """

    transmitter: Antenna
    receiver: Antenna

    def __post_init__(self) -> None:
        if self.transmitter.urban_map != self.receiver.urban_map:
            raise InputError("transmitter and receiver stand in different urban maps, expected one map")

    @cached_property
    def paths(self) -> NDArray[np.int64]:
        """Image of the transmitter and of the receiver of each path, (path, 2), ordered by the number of walls."""
        out, back = self.transmitter.order, self.receiver.order
        walls = out[:, None] + back
        pairs = np.argwhere(walls <= MOST_WALLS)
        return pairs[np.argsort(walls[walls <= MOST_WALLS], kind="stable")]

    @cached_property
    def walls(self) -> NDArray[np.int64]:
        """Number of walls of each path, (path,)."""
        return np.asarray(self.transmitter.order[self.paths[:, 0]] + self.receiver.order[self.paths[:, 1]])

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Each path as the paper writes it, T transmitter, X target, C wall, R receiver: ``"TXR"``, ``"TXCR"``, ..."""
        out, back = self.transmitter.order[self.paths[:, 0]], self.receiver.order[self.paths[:, 1]]
        return tuple(f"T{'C' * o}X{'C' * b}R" for o, b in zip(out.tolist(), back.tolist(), strict=True))

    @cached_property
    def reflected(self) -> Array:
        """Fraction of the power left after the walls of each path, (path,)."""
        return np.asarray(
            self.transmitter.reflected[self.paths[:, 0]] * self.receiver.reflected[self.paths[:, 1]], np.float64
        )

    def visible(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Which paths no wall blocks, for a target at points (x, y) in m, (..., 2): (..., path)."""
        out, back = self.transmitter.visible(points), self.receiver.visible(points)
        return out[..., self.paths[:, 0]] & back[..., self.paths[:, 1]]

    def measure(self, state: ArrayLike) -> Array:
        """(r in m, rdot in m/s) over each path, visible or not, of x = (x, y, xdot, ydot), (..., 4): (..., path, 2)."""
        state = check_finite("state", state, 4)[..., None, :]
        images = self.transmitter.images[self.paths[:, 0]], self.receiver.images[self.paths[:, 1]]
        return multistatic_range_and_rate(state, *images)

    def directions(self, points: ArrayLike) -> Array:
        """Direction cosine of each path at the array of the receiver, visible or not, (..., path), in [-1, 1].

        The cosine of the angle between the axis of the array and the direction of arrival. A linear array does not tell
        a direction from its mirror image in the axis.

        Args:
            points: the target, (x, y) in m, (..., 2).
        """
        images = self.receiver.images[self.paths[:, 1]]
        towards = check_finite("points", points, 2)[..., None, :] - images
        along = (towards * self.receiver.axes[self.paths[:, 1]]).sum(axis=-1)
        return np.asarray(along / np.hypot(towards[..., 0], towards[..., 1]))

    def delays(self, state: ArrayLike, path: ArrayLike, times: ArrayLike, offsets: ArrayLike) -> Array:
        """Delay of each path at each element of the receiver while the target moves, s, (n, time, element).

        The delay holds Doppler shift, direction and its rate: the phase of an echo is -2 pi fc times the delay.

        Args:
            state: x = (x, y, xdot, ydot, xddot, yddot), SI units, (n, 6).
            path: index of the path of each, (n,).
            times: times at which the delay is wanted, with constant acceleration, s, (time,).
            offsets: positions of the elements along the axis of the receiver, m, (element,).

        Raises:
            InputError: a wrong shape, numbers that are not finite, or no index of a path.
        """
        state, path = check_finite("state", state, 6), np.asarray(path)
        if state.ndim != 2 or path.shape != state.shape[:1]:
            raise InputError(f"state and path have shapes {state.shape} and {path.shape}, expected (n, 6) and (n,)")
        check_elements(lambda name, number: check_within(name, number, 0, len(self.paths) - 1), "path", path)
        if (path != np.floor(path)).any():
            raise InputError(f"path is {path.tolist()}, expected integers")
        times, offsets = (
            np.array(check_finite(name, values), ndmin=1) for name, values in (("times", times), ("offsets", offsets))
        )
        if times.ndim > 1 or offsets.ndim > 1:
            raise InputError(f"times and offsets have shapes {times.shape} and {offsets.shape}, expected one axis each")
        out, back = self.paths[path.astype(np.int64)].T
        delays = np.empty((len(path), len(times), len(offsets)))
        images = self.transmitter.images[out], self.receiver.images[back], self.receiver.axes[back]
        path_delays(np.array(state, order="C"), *images, offsets, times, SPEED_OF_LIGHT, delays)
        return delays

    def background(self) -> Echoes:
        """Echoes without a target: over one wall (TCR), two walls (TCCR), or one small scatterer (TCR)."""
        mirrors = self.transmitter.visible(self.receiver.position) & (self.transmitter.order > 0)
        length = np.linalg.norm(self.transmitter.images - np.array(self.receiver.position), axis=1)
        scatterers = np.array(self.transmitter.urban_map.discretes, np.float64).reshape(-1, 2)
        lit = self.transmitter.visible(scatterers)[:, 0] & self.receiver.visible(scatterers)[:, 0]
        still = np.concatenate([scatterers, np.zeros_like(scatterers)], axis=1)
        scattered = multistatic_range_and_rate(still, self.transmitter.position, self.receiver.position)[:, 0]
        r = np.concatenate([length[mirrors] / 2.0, scattered[lit]])
        reflected = np.concatenate([self.transmitter.reflected[mirrors], np.ones(lit.sum())])
        return Echoes(r, reflected, np.concatenate([self.transmitter.images[mirrors], scatterers[lit]]))


def multilaterate(
    measurements: ArrayLike, R: ArrayLike, transmitter: ArrayLike, receivers: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Both states that fit one target's measurements at two receivers, with covariances to first order.

    Args:
        measurements: z = (r in m, rdot in m/s) at each receiver: half the path transmitter, target, receiver, and its
            rate, (..., 2, 2).
        R: their error covariances, (..., 2, 2, 2).
        transmitter: (x, y) in m, (2,).
        receivers: (x, y) in m, (2, 2); not in one line with the transmitter.

    Returns:
        States (x, y, xdot, ydot) in m and m/s, (..., 2, 4), and covariances (..., 2, 4, 4); NaN where the range
        ellipses do not intersect. Receivers close together give a large error across the line of sight.

    Raises:
        InputError: shapes that do not fit, numbers that are not finite, an R that is not symmetric positive
            semidefinite, or antennas in one line.
    """
    z, errors = check_finite("measurements", measurements, 2, 2), check_last_axes("R", R, 2, 2, 2)
    check_covariance("R", errors)
    t, s = checked_copy("transmitter", transmitter, 2), checked_copy("receivers", receivers, 2, 2)
    check_triangle(t, s)
    try:
        lead = np.broadcast_shapes(z.shape[:-2], errors.shape[:-3])
    except ValueError:
        raise InputError(
            f"measurements and R have shapes {z.shape} and {errors.shape}, expected (..., 2, 2) and (..., 2, 2, 2) "
            "that broadcast"
        ) from None
    z, errors = flatten_lead(z, lead, 2, 2), flatten_lead(errors, lead, 2, 2, 2)
    x, P = np.empty((len(z), 2, 4)), np.empty((len(z), 2, 4, 4))
    kernels.multilaterate(z, errors, t, s, x, P)
    return x.reshape(*lead, 2, 4), P.reshape(*lead, 2, 4, 4)


def check_triangle(transmitter: FloatArray, receivers: FloatArray) -> None:
    """Raise an InputError if a transmitter (2,) and two receivers (2, 2) are not finite or stand in one line."""
    a, b = check_finite("receivers", receivers) - check_finite("transmitter", transmitter)
    if abs(a[0] * b[1] - a[1] * b[0]) <= 1e-9 * np.linalg.norm(a) * np.linalg.norm(b):
        raise InputError(
            f"transmitter {transmitter.tolist()} and receivers {receivers.tolist()} stand in one line, expected a"
            " triangle: in one line they cannot tell left from right"
        )
