"""Timing of pulses: how long the transmitter is on, and which ranges and speeds its pulses leave blind or ambiguous.

Sources: Skolnik, Introduction to Radar Systems, 3rd ed. 2001, chapters 1 and 3; Richards, Fundamentals of Radar Signal
Processing, 2nd ed. 2014, chapter 5. ``docs/waveform_timing.md`` derives each quantity.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.action_sets import quantity
from wavegym.core.arrays import FloatArray, check_elements
from wavegym.core.errors import InputError, check_int, check_non_negative, check_positive
from wavegym.waveforms.fisher import SPEED_OF_LIGHT
from wavegym.waveforms.pulse_train import PulseTrain
from wavegym.waveforms.waveform import Waveform

ENERGY = 0.99
"""Share of a pulse's energy that defines its interval on the transmitter, unless another definition is named."""

_HALF_C = 0.5 * SPEED_OF_LIGHT


def transmitted_interval(
    waveform: Waveform, energy: float | None = None, level_db: float | None = None
) -> tuple[float, float]:
    """First and last time (s, in the pulse's own time) at which a pulse occupies the transmitter.

    A pulse with smooth edges has no end, so its length needs a definition. By energy: the central interval that holds
    this share of the energy, with equal shares before and after. By level: from the first to the last time at which the
    amplitude exceeds this level below its peak. A Gaussian pulse of duration parameter k occupies 3.643 k at 99 % of
    the energy and 7.434 k at -60 dB (its ``effective_length``). A trapezoid chirp occupies its whole duration at 100 %.

    Args:
        waveform: any waveform; of a ``PulseTrain``, its single pulse.
        energy: share in (0, 1]; default 0.99. At 1 the whole ``support``.
        level_db: level in dB below the peak, < 0; instead of ``energy``.

    Raises:
        InputError: no waveform, both definitions, an energy outside (0, 1], or a level that is not finite and < 0.
    """
    if not isinstance(waveform, Waveform):
        raise InputError(f"waveform is {waveform!r}, expected a Waveform such as GaussianChirp(duration=1e-6)")
    if energy is not None and level_db is not None:
        raise InputError(f"energy is {energy!r} and level_db is {level_db!r}, expected one of them")
    if level_db is not None:
        if not (math.isfinite(level_db) and level_db < 0.0):
            raise InputError(f"level_db is {level_db!r} dB, expected a level below the peak, < 0 (nearest: -60)")
        return waveform.level_interval(10.0 ** (level_db / 20.0))
    share = ENERGY if energy is None else energy
    if not 0.0 < share <= 1.0:
        closest = 1.0 if share > 1.0 else ENERGY
        raise InputError(f"energy is {share!r}, expected a share in (0, 1] (nearest: {closest:g})")
    return waveform.energy_interval(share)


@dataclass(frozen=True, kw_only=True)
class PulseTiming:
    """Pulses of one dwell on a monostatic radar: what their duration and interval leave blind or ambiguous.

    A single pulse (``interval=None``) folds neither range nor velocity: both unambiguous intervals are infinite, prf
    and duty cycle are 0. One pulse at an interval (``count=1``) folds range alone: Doppler is measured within a pulse.

    Args:
        duration: time for which a pulse occupies the transmitter, s (``transmitted_interval``).
        carrier_hz: carrier frequency, Hz.
        interval: PRI, from the start of a pulse to that of the next, s; None for one pulse per dwell.
        count: number of pulses of a coherent processing interval, >= 1.
        recovery: time after a pulse until the receiver is open, s.
        max_duty: greatest duty cycle of the transmitter, in (0, 1].

    Raises:
        InputError: an invalid value, or a pulse that does not fit the interval or the duty; names a valid value.
    """

    duration: float
    carrier_hz: float
    interval: float | None = None
    count: int = 1
    recovery: float = 0.0
    max_duty: float = 1.0

    def __post_init__(self) -> None:
        check_positive("duration", self.duration, "s")
        check_positive("carrier_hz", self.carrier_hz, "Hz")
        check_int("count", self.count, 1)
        check_non_negative("recovery", self.recovery, "s")
        if not 0.0 < self.max_duty <= 1.0:
            raise InputError(f"max_duty is {self.max_duty!r}, expected a share of the time in (0, 1] (nearest: 1)")
        if self.interval is None:
            if self.count > 1:
                raise InputError(f"interval is None, expected the time between the {self.count} pulses (PRI), s")
            return
        check_positive("interval", self.interval, "s")
        closed = self.duration + self.recovery
        if not self.interval > closed:
            raise InputError(
                f"interval (PRI) is {float(self.interval)!r} s, PRF {1.0 / self.interval:.6g} Hz, expected room for "
                f"the pulse and its recovery, {closed:.6g} s, and for echoes (nearest: interval > {closed:.6g}, "
                f"PRF < {1.0 / closed:.6g})"
            )
        if self.duration > self.max_duty * self.interval * (1.0 + 1e-12):
            raise InputError(
                f"duty cycle is {self.duration / self.interval:.6g} ({quantity(self.duration, 's')} every "
                f"{quantity(self.interval, 's')}), expected at most max_duty, {self.max_duty:g} (nearest: interval "
                f"{self.duration / self.max_duty:.6g} or duration {self.max_duty * self.interval:.6g})"
            )

    @classmethod
    def of(
        cls,
        waveform: Waveform,
        carrier_hz: float,
        energy: float | None = None,
        level_db: float | None = None,
        **timing: float,
    ) -> PulseTiming:
        """The timing of a waveform: its transmitted interval's length and, of a ``PulseTrain``, interval and count.

        ``interval``, ``recovery`` and ``max_duty`` may also be given, and ``count`` for a single pulse.
        """
        first, last = transmitted_interval(waveform, energy, level_db)
        if isinstance(waveform, PulseTrain):
            timing = {"interval": waveform.interval, "count": waveform.count} | timing
        return cls(duration=last - first, carrier_hz=carrier_hz, **timing)  # type: ignore[arg-type]

    @property
    def wavelength(self) -> float:
        """lambda = c/fc, m."""
        return SPEED_OF_LIGHT / self.carrier_hz

    @property
    def prf(self) -> float:
        """Pulse repetition frequency 1/PRI, Hz; 0 for a single pulse."""
        return 0.0 if self.interval is None else 1.0 / self.interval

    @property
    def duty_cycle(self) -> float:
        """Share of the time for which the transmitter is on, duration/PRI; 0 for a single pulse."""
        return self.duration * self.prf

    @property
    def time_on_air(self) -> float:
        """count x duration, s: peak power times this is the energy of a dwell, and this over a step its mean duty."""
        return self.count * self.duration

    @property
    def coherent_processing_interval(self) -> float:
        """count x PRI, s; the duration for a single pulse."""
        return self.duration if self.interval is None else self.count * self.interval

    @property
    def blind_range(self) -> float:
        """c (duration + recovery)/2, m: nearer echoes arrive while the receiver is closed, in part or whole."""
        return _HALF_C * (self.duration + self.recovery)

    @property
    def unambiguous_range(self) -> float:
        """c PRI/2, m: targets that far apart have the same apparent range; inf for a single pulse."""
        return math.inf if self.interval is None else _HALF_C * self.interval

    @property
    def unambiguous_velocity(self) -> float:
        """lambda PRF/2, m/s, the full interval: range-rates in [-lambda PRF/4, lambda PRF/4) are unambiguous.

        inf for one pulse.
        """
        return math.inf if self.interval is None or self.count == 1 else 0.5 * self.wavelength / self.interval

    def blind_speeds(self, number: int) -> FloatArray:
        """The first blind speeds n lambda PRF/2, n = 1 ... number, m/s, (number,): they look like a target at rest."""
        check_int("number", number, 1)
        return np.arange(1.0, number + 1.0) * self.unambiguous_velocity

    def range_blind_zones(self, farthest: float) -> FloatArray:
        """Ranges up to ``farthest`` (m) whose echoes the receiver misses in part or whole: low and high, (zones, 2).

        Every multiple m of the unambiguous range lies in a zone: an echo is cut if it begins less than duration +
        recovery after the start of a pulse, or ends after the start of the next one. Zones overlap at more than
        half duty.
        """
        check_non_negative("farthest", farthest, "m")
        before, interval = _HALF_C * self.duration, self.unambiguous_range
        most = 0 if math.isinf(interval) else math.floor((farthest + before) / interval)
        centres = np.arange(most + 1) * (0.0 if most == 0 else interval)
        zones = np.stack([np.maximum(centres - before, 0.0), centres + self.blind_range], axis=-1)
        return zones[zones[:, 0] <= farthest]

    def velocity_blind_zones(self, notch: float, fastest: float) -> FloatArray:
        """Range-rates up to +-``fastest`` (m/s) that a clutter notch removes: low and high, (zones, 2), rising.

        Args:
            notch: half the width of the notch around the speed 0, m/s; every blind speed has its own.
            fastest: greatest speed of a target, m/s.

        Raises:
            InputError: a value that is negative or not finite, or a notch that leaves no velocity to see.
        """
        check_non_negative("notch", notch, "m/s")
        check_non_negative("fastest", fastest, "m/s")
        width = self.unambiguous_velocity
        if not 2.0 * notch < width:
            raise InputError(
                f"notch is {notch!r} m/s, expected less than half the unambiguous velocity, {0.5 * width:.6g} m/s "
                f"(nearest: {0.499 * width:.6g})"
            )
        most = 0 if math.isinf(width) else math.floor((fastest + notch) / width)
        centres = np.arange(-most, most + 1) * (0.0 if most == 0 else width)
        return np.stack([centres - notch, centres + notch], axis=-1)

    def time_on_target(self, farthest: float) -> float:
        """From the start of the first pulse to the end of the last echo from ``farthest`` (m), s.

        (count - 1) PRI + duration + 2 r/c: echoes from beyond the unambiguous range come whole intervals later.
        """
        check_non_negative("farthest", farthest, "m")
        between = 0.0 if self.interval is None else (self.count - 1) * self.interval
        return between + self.duration + farthest / _HALF_C


def pulse_timings(waveforms: Iterable[Waveform], carrier_hz: float) -> dict[str, PulseTiming]:
    """The timing of every waveform (``PulseTiming.of``) by its label. Carrier in Hz; errors are those of the class."""
    timed = [(PulseTiming.of(waveform, carrier_hz), waveform) for waveform in waveforms]
    return {waveform.label: timing for timing, waveform in timed}


def check_time_on_target(timings: Mapping[str, PulseTiming], step: float, farthest: float = 0.0) -> None:
    """Check that every pulse or train fits into a step.

    Args:
        timings: of the pulses, by label.
        step: time between two decisions, s, > 0.
        farthest: range whose echo counts too, m, >= 0; 0: the transmission alone.

    Raises:
        InputError: a value out of range; or the first pulse that takes longer, its time, and what fits.
    """
    check_positive("step", step, "s")
    for label, timing in timings.items():
        time = timing.time_on_target(farthest)
        if time > step:
            spare = step - farthest / _HALF_C - timing.duration
            fits = f"{max(spare + timing.duration, 0.0):.6g} s of transmission"
            if timing.interval is not None and spare >= 0.0:
                fits = f"{1 + int(spare / timing.interval)} pulses"
            raise InputError(f"{label} takes {time:.6g} s, expected at most the step, {step!r} s (nearest: {fits})")


def check_range_folds(timings: Mapping[str, PulseTiming], farthest: float) -> None:
    """Check that no target is farther than the unambiguous range of any pulse or train.

    Args:
        timings: of the pulses, by label.
        farthest: range of the farthest target, m.

    Raises:
        InputError: a value out of range; or the first pulse whose range folds, where it does, and what fits.
    """
    check_non_negative("farthest", farthest, "m")
    for label, timing in timings.items():
        if timing.unambiguous_range < farthest:
            raise InputError(
                f"range of {label} folds at {timing.unambiguous_range:.6g} m, expected at least the range of the "
                f"farthest target, {farthest:.6g} m (nearest: interval {farthest / _HALF_C:.6g})"
            )


def check_velocity_folds(timings: Mapping[str, PulseTiming], fastest: float) -> None:
    """Check that no range-rate is beyond the unambiguous interval of any train, +-lambda PRF/4.

    Args:
        timings: of the pulses, by label.
        fastest: greatest speed of a target, m/s.

    Raises:
        InputError: a value out of range; or the first train whose range-rate folds, where it does, and what fits.
    """
    check_non_negative("fastest", fastest, "m/s")
    for label, timing in timings.items():
        limit = 0.5 * timing.unambiguous_velocity
        if limit < fastest:
            raise InputError(
                f"range-rate of {label} folds at {limit:.6g} m/s, expected at least the speed of the fastest target, "
                f"{fastest:.6g} m/s (nearest: interval {0.25 * timing.wavelength / fastest:.6g})"
            )


def time_left(dwells: ArrayLike, step: ArrayLike, switching: ArrayLike = 0.0) -> FloatArray:
    """What dwells leave of a step's time, s, (...): step - sum over (dwell + switching). Negative: they do not fit.

    Args:
        dwells: times on target, s, >= 0, (..., dwell), such as ``PulseTiming.time_on_target``.
        step: time between two decisions, s, > 0, (...).
        switching: time from one dwell to the next (beam, PRF), once for each dwell, s, >= 0, (...).

    Raises:
        InputError: a value out of range, or dwells without an axis.
    """
    times = check_elements(check_non_negative, "dwells", dwells)
    if times.ndim == 0:
        raise InputError(f"dwells is {float(times)!r}, expected an axis of dwells, (..., dwell)")
    whole = check_elements(check_positive, "step", step)
    between = check_elements(check_non_negative, "switching", switching)
    return whole - (times.sum(axis=-1) + times.shape[-1] * between)


def check_dwells(dwells: ArrayLike, step: float, switching: float = 0.0) -> float:
    """Return what dwells, (dwell,), leave of the step (s) if they fit into it; otherwise raise an InputError.

    Arguments and other errors: see ``time_left``.
    """
    times = np.asarray(dwells, dtype=np.float64)
    left = time_left(times, step, switching)
    if left.ndim:
        raise InputError(f"dwells has shape {times.shape}, expected one axis, (dwell,)")
    if left < -1e-12 * step:
        fit = int(np.searchsorted(np.cumsum(times + switching), step * (1.0 + 1e-12), side="right"))
        raise InputError(
            f"dwells take {step - float(left):.6g} s, expected at most the step, {step!r} s (nearest: the first {fit} "
            f"of {len(times)}, or a step of {step - float(left):.6g} s)"
        )
    return float(left)
