"""Scripted paths: straight segments, speed changes and turns in closed form, one after another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_positive

STANDSTILL = 1e-9  # relative to the speed before: a smaller speed is a rounding error, the target has stopped


class Kinematics(NamedTuple):
    """Position [m], velocity [m/s] and acceleration [m/s²] at the same times, each (..., d)."""

    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray


@dataclass(frozen=True, eq=False)
class Segment:
    """A stretch of a path with constant acceleration, or constant turn rate and tangential acceleration.

    Args:
        duration: seconds, > 0.
        acceleration: a vector [m/s²] with one entry per axis; or a number along the direction of motion (< 0 brakes, at
            most to a standstill).
        turn_rate: rate of turn [rad/s], positive to the left; in two axes only, not with a vector acceleration.

    Raises:
        InputError: duration not > 0, a number that is not finite, or a turn rate with a vector acceleration.
    """

    duration: float
    acceleration: float | Sequence[float] | FloatArray = 0.0
    turn_rate: float = 0.0

    def __post_init__(self) -> None:
        check_positive("duration", self.duration, "s")
        if not np.isfinite(self.acceleration).all():
            raise InputError(f"acceleration is {self.acceleration!r}, expected finite numbers [m/s²]")
        if not math.isfinite(self.turn_rate):
            raise InputError(f"turn_rate is {self.turn_rate!r}, expected a finite number [rad/s]")
        if self.turn_rate and np.ndim(self.acceleration):
            raise InputError(
                f"turn_rate is {self.turn_rate!r} with a vector acceleration, expected a number along the motion"
            )


@dataclass(frozen=True, eq=False)
class ScriptedPath:
    """A path of segments with exact positions, velocities and accelerations.

    After the last segment the target keeps its velocity. Between two segments the acceleration is that of the second.

    Args:
        start: first position [m], 1 to 3 axes.
        velocity: first velocity [m/s], as many axes.
        segments: the segments in order.

    Raises:
        InputError: an invalid shape or value, a turn in other than two axes, or a motion that is impossible.
    """

    start: Sequence[float] | FloatArray
    velocity: Sequence[float] | FloatArray
    segments: Sequence[Segment] = ()

    def __post_init__(self) -> None:
        p, v = np.asarray(self.start, np.float64), np.asarray(self.velocity, np.float64)
        if p.ndim != 1 or not 1 <= len(p) <= 3 or p.shape != v.shape:
            raise InputError(
                f"start and velocity have shapes {p.shape} and {v.shape}, expected equal ones, 1 to 3 axes"
            )
        if not (np.isfinite(p).all() and np.isfinite(v).all()):
            raise InputError(f"start and velocity are {p.tolist()} and {v.tolist()}, expected finite numbers")
        _ = self._legs  # raises here, not at the first sample, if a segment is impossible

    @property
    def duration(self) -> float:
        """Length of the scripted part [s]."""
        return math.fsum(segment.duration for segment in self.segments)

    def sample(self, times: ArrayLike) -> Kinematics:
        """Position, velocity and acceleration of the target at any times.

        Args:
            times: seconds from the start, >= 0, any shape (...).

        Returns:
            Positions [m], velocities [m/s] and accelerations [m/s²], each (..., d).

        Raises:
            InputError: a negative time, or one that is not finite.
        """
        t = np.asarray(times, np.float64)
        if not (np.isfinite(t) & (t >= 0)).all():
            raise InputError(
                "times holds a value that is negative or not finite, expected seconds from the start, >= 0"
            )
        begins = np.array([leg.begin for leg in self._legs])
        which = np.searchsorted(begins, t, side="right") - 1
        result = Kinematics(*(np.empty((*t.shape, len(self.start))) for _ in range(3)))
        for i in np.unique(which):
            here = which == i
            for whole, part in zip(result, self._legs[i].at(t[here] - begins[i]), strict=True):
                whole[here] = part
        return result

    @cached_property
    def _legs(self) -> list[_Leg]:
        v = np.asarray(self.velocity, np.float64)
        position, speed = np.asarray(self.start, np.float64), float(np.linalg.norm(v))
        heading = v / speed if speed else None
        legs, begin = [], 0.0
        for number, segment in enumerate([*self.segments, None]):
            leg = _leg(begin, position, speed, heading, segment, number)
            legs.append(leg)
            if segment is not None:
                begin += segment.duration
                position, speed, heading = leg.end(segment.duration)
        return legs


@dataclass(frozen=True)
class _Leg:
    """A segment with its start in space and time.

    With a speed s along a heading u, position is p + ∫ (s + a t) R(ω t) u dt + b t²/2.
    """

    begin: float
    position: FloatArray  # (d,)
    speed: float
    heading: FloatArray | None  # (d,), unit vector of the last motion; None if the target has never moved
    tangential: float = 0.0
    turn_rate: float = 0.0
    vector: FloatArray | float = 0.0  # (d,), b

    def at(self, t: FloatArray) -> Kinematics:
        """Kinematics ``t`` (time,) seconds into the leg, each (time, d)."""
        t = t[:, None]
        zero = np.zeros((len(t), len(self.position)))
        p, v, a = self.position + self.vector * t * t / 2, self.vector * t, self.vector + zero
        if self.heading is None:
            return Kinematics(p + zero, v + zero, a)
        speed = self.speed + self.tangential * t
        if not self.turn_rate:
            along = self.speed * t + self.tangential * t * t / 2
            return Kinematics(p + along * self.heading, v + speed * self.heading, a + self.tangential * self.heading)
        u = complex(*self.heading)
        turned = u * np.exp(1j * self.turn_rate * t)
        moved = u * (
            self.speed * t * _moment(0, self.turn_rate * t) + self.tangential * t * t * _moment(1, self.turn_rate * t)
        )
        return Kinematics(
            p + _plane(moved),
            _plane(speed * turned),
            _plane((self.tangential + 1j * self.turn_rate * speed) * turned),
        )

    def end(self, duration: float) -> tuple[FloatArray, float, FloatArray | None]:
        """Position, speed and heading at the end of the leg; a target at a standstill keeps its heading."""
        last = self.at(np.array([duration]))
        velocity = last.velocities[0]
        speed = float(np.linalg.norm(velocity))
        scale = self.speed + float(np.linalg.norm(self.vector)) * duration
        if speed > STANDSTILL * scale:
            return last.positions[0], speed, velocity / speed
        return last.positions[0], 0.0, self.heading


def _leg(
    begin: float, position: FloatArray, speed: float, heading: FloatArray | None, segment: Segment | None, number: int
) -> _Leg:
    if segment is None:
        return _Leg(begin, position, speed, heading)
    axes = len(position)
    where = f"segments[{number}]"
    if segment.turn_rate and axes != 2:
        raise InputError(f"{where}: turn_rate is {segment.turn_rate!r} in {axes} axes, expected 2 axes")
    if np.ndim(segment.acceleration):
        vector = np.asarray(segment.acceleration, np.float64)
        if vector.shape != (axes,):
            raise InputError(f"{where}: acceleration has shape {vector.shape}, expected ({axes},) or a number")
        return _Leg(begin, position, speed, heading, vector=vector)
    tangential = float(np.asarray(segment.acceleration))
    if heading is None and (tangential or segment.turn_rate):
        raise InputError(f"{where}: the target has no direction of motion yet, expected a vector acceleration")
    if speed + tangential * segment.duration < -STANDSTILL * speed:
        stop = -speed / tangential
        raise InputError(f"{where}: braking for {segment.duration:g} s goes beyond standstill (nearest: {stop:g} s)")
    return _Leg(begin, position, speed, heading, tangential, segment.turn_rate)


def _plane(z: NDArray[np.complex128]) -> FloatArray:
    """Complex (time, 1) as x and y, (time, 2)."""
    return np.concatenate([z.real, z.imag], axis=-1)


def _moment(power: int, angle: FloatArray) -> NDArray[np.complex128]:
    """∫₀¹ xᵐ exp(j φ x) dx for m = 0 or 1; a series where the closed form would cancel."""
    z = 1j * np.asarray(angle)
    small = np.abs(z) < 1.0
    # 20 terms: the next is below 1/20! = 4e-19
    series = sum(np.where(small, z, 0) ** k / (math.factorial(k) * (k + power + 1)) for k in range(20))
    w = np.where(small, 1.0, z)
    closed = (np.exp(w) - 1) / w if power == 0 else (np.exp(w) * (w - 1) + 1) / (w * w)
    return np.where(small, series, closed)
