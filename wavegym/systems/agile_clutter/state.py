"""Several targets seen by several sensors: tape, truth, belief, and what an agent is shown of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_non_negative, check_positive, check_probability, check_within
from wavegym.core.system import ObservationField
from wavegym.sensors import gate_volume, range_and_rate, range_and_rate_jacobian, range_law_snr
from wavegym.trackers import Particles
from wavegym.trackers.joint_association_kernels import CLUSTER_LIMIT

if TYPE_CHECKING:
    from wavegym.systems.agile_clutter.system import AgileClutter


MOST_SENSORS = 16


class World(NamedTuple):
    """One episode's tape."""

    start: Array  # (target, 4) normal: error of the first estimate
    process: Array  # (target, lifetime, 4) normal: manoeuvres
    detection: Array  # (H, sensor, target) uniform: detected where below Pd
    error: Array  # (H, sensor, target, 2) normal: measurement error
    key: Array  # () uint64: of the counter-based draws, clutter and particles


class Truth(NamedTuple):
    """What no scheduler sees."""

    targets: Array  # (env, target, 4)
    path: Array  # (env, target, lifetime + 1, 4) from each target's birth
    first: Array  # (env, target, 4) the estimates that the tracker is handed at birth
    outside: Array  # (env, target) int: returns that fell outside their own target's gate so far
    scan: Array  # (env, 4) of the last step: detections, clutter points, effective sample size, distinct ancestors


class Belief(NamedTuple):
    """The belief. A slot whose target is still to come holds where it is expected to start, and P0."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    particles: Particles | None  # (env, particle, target, ...) each; None with tracker="jpda" and in prediction


class Pulse(NamedTuple):
    """What the sensors transmit and where they look; axes 0 and 1 may be 1 where all share it."""

    C: Array  # (env, candidate, sensor, 2, 2) measurement covariance at unit SNR
    strength: Array  # (env, candidate, sensor) > 0: the SNR is so many times that of the range law
    chance: Array  # (env, candidate, sensor, target) that a target is looked at and can be seen; 0 opens no gate

    def rows(self, shape: tuple[int, int]) -> tuple[Array, ...]:
        """With one flat axis for (env, candidate) of ``shape``, or of length 1 where all share it."""
        flat = []
        for array in self:
            if array.shape[:2] == (1, 1):
                flat.append(array[0])
            else:
                full = array if array.shape[:2] == shape else np.broadcast_to(array, shape + array.shape[2:])
                flat.append(np.ascontiguousarray(full).reshape(-1, *array.shape[2:]))
        return tuple(flat)


class Ahead(NamedTuple):
    """The belief that the next pulse meets, for scheduling sensor by sensor."""

    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4) after the sensors that were scheduled already
    present: Array  # (env, target) bool


def drawn_around(centre: ArrayLike, spread: ArrayLike, place: Array) -> Array:
    """Uniform draws ``place`` (..., target, 4) as states at most ``spread`` (4,) from ``centre`` (target, 4)."""
    return np.array(centre) + np.array(spread) * (2.0 * place - 1.0)


def target_fields(targets: int, sensors: int) -> tuple[ObservationField, ...]:
    """Observation elements: time left, and of every target what the next pulse meets, by itself and at each sensor."""
    listed = [ObservationField("time_left", "1", 0.5, 0.3, "fraction of the horizon still to come")]
    for t in range(1, targets + 1):
        of = f"of target {t} as the next pulse meets it; 0 where it meets none"
        listed += [
            ObservationField(f"present_{t}", "1", 0.5, 0.5, f"whether the next pulse meets target {t}"),
            ObservationField(f"log10_sigma_position_{t}", "log10(m)", 1.0, 1.0, f"RMS position uncertainty {of}"),
            ObservationField(f"log10_sigma_velocity_{t}", "log10(m/s)", 0.5, 0.5, f"RMS velocity uncertainty {of}"),
        ]
        for i in range(1, sensors + 1):
            at, where = f"{t}_{i}", f"{of}, at sensor {i}"
            listed += [
                ObservationField(f"snr_{at}", "dB", 19.0, 3.0, f"eta {where}"),
                ObservationField(f"log10_sigma_r_{at}", "log10(m)", 0.5, 0.5, f"standard deviation of range {where}"),
                ObservationField(f"log10_sigma_rdot_{at}", "log10(m/s)", 0.5, 0.5, f"the same of range-rate {where}"),
                ObservationField(f"correlation_{at}", "1", 0.0, 0.5, f"correlation of range and range-rate {where}"),
            ]
    return tuple(listed)


def check_numbers(system: AgileClutter) -> None:
    """InputError for single numbers out of range."""
    for name in ("dt", "carrier_hz", "reference_range", "nearest_range", "gate"):
        check_positive(name, getattr(system, name))
    check_non_negative("q", system.q)
    for name, check in (("prior_variance", check_positive), ("weights", check_non_negative)):
        for value in getattr(system, name):
            check(name, value)
    check_positive("sum of weights", sum(system.weights))
    for sweep in system.sweeps:
        check_positive("sweep", sweep, "Hz")
    check_probability("false_alarm", system.false_alarm)
    check_within("particles", system.particles, 2, 1_000_000)


def check_scenario(
    sensors: Sequence[Sequence[float]],
    starts: Sequence[Sequence[float]],
    births: Sequence[int],
    lifetime: int,
    horizon: int,
) -> None:
    """InputError for sensors, targets or times that make no scenario; arguments as ``AgileClutter`` has them."""
    check_within("number of sensors", len(sensors), 1, MOST_SENSORS)
    check_within("number of targets (exact joint association)", len(starts), 1, CLUSTER_LIMIT)
    for name, rows in (("sensors", sensors), ("starts", starts)):
        if not np.isfinite(np.array(rows)).all():
            raise InputError(f"{name} is {rows}, expected finite numbers")
    if len(births) != len(starts):
        raise InputError(f"births is {births}, expected {len(starts)} steps, one for each of starts")
    check_within("lifetime", lifetime, 1, 100_000, "steps")
    last = max(births) + lifetime
    if not 1 <= horizon <= last:
        wanted = f"1 to {last}, when the last target is gone (the greatest of births + lifetime)"
        raise InputError(f"horizon is {horizon} steps, expected {wanted}; nearest: {min(max(horizon, 1), last)}")
    check_within("least of births", min(births), 0, horizon - 1)


def first_gate_volume(
    starts: ArrayLike, variance: ArrayLike, sensors: ArrayLike, C: Array, law: tuple[float, float], gate: float
) -> float:
    """The largest gate, m (m/s), that any target meets at any sensor before its first measurement.

    Args:
        starts: [x y xdot ydot] of each target, (target, 4).
        variance: diagonal of P0, (4,).
        sensors: positions, (sensor, 2).
        C: measurement covariances at unit SNR of what may be transmitted, (option, 2, 2).
        law: reference and nearest range of the SNR, m.
        gate: radius in standard deviations.
    """
    places = np.asarray(sensors)[:, None]
    H = range_and_rate_jacobian(starts, places)  # (sensor, target, 2, 4)
    eta = range_law_snr(range_and_rate(starts, places)[..., 0], *law)
    S = (H * np.asarray(variance) @ np.swapaxes(H, -1, -2))[:, :, None] + C / eta[..., None, None, None]
    return float(gate_volume(S, gate).max())
