"""The pulses of a radar with Gaussian chirps, a library or the box that it spans, and what a closed receiver misses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import erfinv

from wavegym.core.action_sets import Library, Parameter, ParameterBox
from wavegym.core.arrays import Array, for_kernel
from wavegym.sensors.eclipsing import EclipsedLibrary, EclipsedPulse
from wavegym.systems.kershaw_evans import kernels
from wavegym.systems.kershaw_evans.kernels import visible_shares
from wavegym.waveforms import gaussian_chirp_library, measurement_covariances
from wavegym.waveforms.fisher import unchecked_covariance
from wavegym.waveforms.gaussian import unchecked_gaussian_factors
from wavegym.waveforms.timing import ENERGY

HALF_LENGTH = float(erfinv(ENERGY))
"""Half of the interval that holds this share of the energy, in durations k."""


def visible_information(duration: Array, range_m: Array) -> Array:
    """Share of a Gaussian chirp's Fisher information that is left in the echo of its own pulse, at least 1e-9.

    ``wavegym.sensors.eclipsing`` has the same for any waveform, from tables of its moments.

    The receiver opens when the transmitted interval ends, T/2 after the middle of the pulse (T = 3.64 k holds 99 % of
    the energy). Of an echo from range r it receives t >= T/2 - 2 r / c. The derivatives of s(t) by delay and by Doppler
    are both t s(t) times a constant. Their inner products over the open gate, less the projection on s, are therefore
    those of the whole pulse times one number: the variance of t over the gate (weighted with the energy in it) over
    k^2 / 2. With a = sqrt(2) (T/2 - 2 r / c) / k, Q the upper tail of the normal distribution and m = phi(a) / Q(a),
    it is

        h(a) = Q(a) (1 + a m - m^2).

    The gate is fixed in time, so the cut adds no delay information.

    Args:
        duration: k, s, any shape.
        range_m: r, m; broadcasts.
    """
    return visible_shares(duration, range_m, HALF_LENGTH)


class Pulses(NamedTuple):
    """Pulses as kernels take them: a table, which of them are sent, and how the receiver cuts them."""

    C: Array  # (pulse, 2, 2) at unit SNR
    duration: Array  # (pulse,) s
    which: Array  # (...) int
    half_length: float  # of the transmitted interval, in durations; -inf: the receiver is always open


@dataclass(frozen=True)
class GaussianActions:
    """Every duration with every sweep, at the chirp rate g = pi |sweep| / (2 k).

    Args:
        durations: k in seconds.
        sweeps: in Hz, negative = down.
        carrier_hz: fc.
        continuous: actions are points of the box instead of indices.
        eclipsing: whether the receiver is off while a pulse is sent.
        own: pulses to transmit in place of the durations and sweeps.
    """

    durations: tuple[float, ...]
    sweeps: tuple[float, ...]
    carrier_hz: float
    continuous: bool
    eclipsing: bool
    own: Library | None = None

    @cached_property
    def library(self) -> Library:
        """The waveforms, duration-major, or the given ones."""
        return self.own or gaussian_chirp_library(self.durations, self.sweeps)

    @cached_property
    def box(self) -> ParameterBox:
        """Log duration, and the sweep that sets the chirp rate; the largest |sweep| is the radar's bandwidth."""
        largest = max(abs(s) for s in self.sweeps)
        return ParameterBox(
            (
                Parameter("duration", "s", min(self.durations), max(self.durations), "log"),
                Parameter("sweep", "Hz", -largest, largest, "linear"),
            )
        )

    @property
    def actions(self) -> Library | ParameterBox:
        """The action set of this form."""
        return self.box if self.continuous else self.library

    @cached_property
    def _eclipsed_pulses(self) -> EclipsedLibrary:
        """The given pulses as seen by their own radar."""
        return EclipsedLibrary([EclipsedPulse(pulse) for pulse in self.library])

    @cached_property
    def _library_pulses(self) -> tuple[Array, Array]:
        """C (A, 2, 2) and durations (A,) of the library. Durations count where Gaussian chirps are eclipsed."""
        count = len(self.library)
        return self.covariances, np.ones(count) if self.own else np.repeat(self.durations, len(self.sweeps))

    @property
    def middle(self) -> int:
        """The pulse of middle duration with the widest sweep; of given pulses the middle one."""
        if self.own:
            return len(self.own) // 2
        return len(self.durations) // 2 * len(self.sweeps) + int(np.argmax(np.abs(self.sweeps)))

    @cached_property
    def candidates(self) -> Array:
        """The library as actions: indices (A,), or points of the box (A, 2)."""
        if not self.continuous:
            return np.arange(len(self.library))
        return self.box.encode(np.array([(k, s) for k in self.durations for s in self.sweeps]))

    @cached_property
    def covariances(self) -> Array:
        """C (A, 2, 2): measurement covariances of the library at unit SNR."""
        return measurement_covariances(self.library, self.carrier_hz)

    def unit_covariance(self, actions: Array) -> Array:
        """C (..., 2, 2) of the waveforms that ``actions`` name."""
        return self._chirps(actions)[0] if self.continuous else self.covariances.take(actions, axis=0)

    def _chirps(self, points: Array) -> tuple[Array, Array]:
        """C (..., 2, 2) and durations (...) of points of the box."""
        values = self.box.decode(points)
        duration, sweep = values[..., 0], values[..., 1]
        rate = np.pi * sweep / (2.0 * duration)
        return unchecked_covariance(*unchecked_gaussian_factors(duration, rate), self.carrier_hz), duration

    def pulses(self, actions: Array) -> Pulses:
        """The pulses that ``actions`` name, unless they are given ones that a receiver cuts."""
        half_length = HALF_LENGTH if self.eclipsing else -math.inf
        if not self.continuous:
            return Pulses(*self._library_pulses, for_kernel(actions, np.int64), half_length)
        C, duration = self._chirps(actions)
        which = np.arange(duration.size).reshape(duration.shape)
        return Pulses(C.reshape(-1, 2, 2), duration.flatten(), which, half_length)

    def received_covariance(self, actions: Array, ranges: Array) -> Array:
        """C at unit SNR of what the receiver sees of echoes from ``ranges`` (env,) in m, (env or 1, candidate, 2, 2).

        ``actions`` are (env or 1, candidate), in a box (env or 1, candidate, 2). The first axis is that of ``actions``
        without eclipsing. With it the information of a Gaussian chirp falls as a whole; see ``visible_information``.
        """
        if not self.eclipsing:
            return self.unit_covariance(actions)
        if self.own:
            return self._eclipsed_pulses.measurement_covariance(actions, abs(ranges)[:, None], self.carrier_hz)
        C, duration, which, half_length = self.pulses(actions)
        out = np.empty((len(ranges), actions.shape[1], 2, 2))
        kernels.received(C, duration, which, np.array(ranges), half_length, out)
        return out
