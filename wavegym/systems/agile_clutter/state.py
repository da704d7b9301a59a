"""Several targets seen by several sensors: tape, truth, belief, pulses and observation fields."""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import Array, for_kernel
from wavegym.core.parameters import NonNegative, Positive
from wavegym.core.system import ObservationField
from wavegym.sensors import gate_volume, range_and_rate, range_and_rate_jacobian, range_law_snr
from wavegym.trackers import GaussianMixture, Particles

PlanarState = tuple[float, float, float, float]  # [x y xdot ydot]
PositiveState = tuple[Positive, Positive, Positive, Positive]
NonNegativeState = tuple[NonNegative, NonNegative, NonNegative, NonNegative]
TRACKERS = ("mixture", "jpda", "particle")
AT_SENSOR = ("snr", "log10_sigma_r", "log10_sigma_rdot", "correlation")  # fields of every target at every sensor
NN = (0, 0, 0, 0)  # size of [x y xdot ydot], as the kernels take it


class Kept(NamedTuple):
    """What another tracker keeps beside means and covariances."""

    memory: Any
    process_noise: Array | None  # (env, target, 4, 4); schedulers do not read it


Hypotheses = Particles | GaussianMixture | Kept | None  # None with tracker="jpda" and in prediction


class World(NamedTuple):
    """One episode's tape."""

    start: Array  # (target, 4) normal: error of the first estimate
    process: Array  # (target, lifetime, 4) normal: manoeuvres
    error: Array  # (H, sensor, target, 2) normal: measurement error
    key: Array  # () uint64: key of the counter-based draws (echoes, false returns, particles)


class Truth(NamedTuple):
    """The part of the state that no scheduler may see."""

    targets: Array  # (env, target, 4)
    path: Array  # (env, target, lifetime + 1, 4) true states from each target's birth on
    first: Array  # (env, target, 4) estimates that the tracker receives at birth
    outside: Array  # (env, target) int: returns so far outside their target's gates, at the first sensor that looks
    scan: Array  # (env, 4) of the last step: detections, clutter points in those gates, ess, distinct ancestors


class Belief(NamedTuple):
    """The belief. The slot of a target that is not born yet holds its expected start and P0."""

    step: Array  # (env,) int
    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4)
    hypotheses: Hypotheses


class Measurements(NamedTuple):
    """What the sensors report of one step. Only ``annotate`` reads the last two, because they depend on the truth."""

    z: Array  # (env, sensor, return, 2) range and range-rate, by increasing range
    present: Array  # (env, sensor, return) bool: False beyond a sensor's number of returns
    first: Array  # (env, target, 4) the estimate that the tracker receives in this step, at a target's birth; else 0
    outside: Array  # (env, target) int: 1 if the first sensor that looks has its return outside the target's gates
    scan: Array  # (env, 2) detections, clutter points in those gates


class Pulse(NamedTuple):
    """The transmitted pulses and the targets that they can detect; axes 0 and 1 may be 1 where all share a pulse."""

    C: Array  # (env, candidate, sensor, 2, 2) measurement covariance at unit SNR of the whole pulse
    strength: Array  # (env, candidate, sensor) > 0: factor on the SNR of the range law
    chance: Array  # (env, candidate, sensor, target) probability of illuminating a visible target; 0 opens no gate
    alarm: Array  # (env, candidate, sensor) int: row of the receiver's threshold
    window: Array  # (env, candidate, sensor) int: row of ``windows``
    windows: Array  # (row, 11) ``wavegym.sensors.eclipsing.receive_windows``, and the row of the clutter field

    def rows(self, shape: tuple[int, int]) -> Pulse:
        """The fields with one flat axis for (env, candidate) of ``shape``, or of length 1 where all share a pulse."""
        flat = {}
        for name, array in zip(self._fields[:-1], self, strict=False):
            if array.shape[:2] == (1, 1):
                flat[name] = array[0]
            else:
                full = array if array.shape[:2] == shape else np.broadcast_to(array, shape + array.shape[2:])
                flat[name] = for_kernel(full).reshape(-1, *array.shape[2:])
        return self._replace(**flat)


class PredictedTargets(NamedTuple):
    """The belief at the time of the next pulse, for schedulers that choose sensor by sensor."""

    mean: Array  # (env, target, 4)
    covariance: Array  # (env, target, 4, 4) after the pulses of the sensors scheduled so far
    present: Array  # (env, target) bool


def kernel_hypotheses(hypotheses: Hypotheses) -> tuple[Particles | None, GaussianMixture | None, bool | None]:
    """Particles, mixtures and whether each target has one Gaussian, as the kernels take them: None but for one."""
    if isinstance(hypotheses, Particles):
        return hypotheses, None, None
    if isinstance(hypotheses, GaussianMixture):
        return None, hypotheses, None
    return None, None, True


def drawn_around(centre: ArrayLike, spread: ArrayLike, place: Array) -> Array:
    """States within ``spread`` (4,) of ``centre`` (target, 4) from uniform draws ``place`` (..., target, 4)."""
    return np.array(centre) + np.array(spread) * (2.0 * place - 1.0)


def corners(centre: ArrayLike, spread: ArrayLike) -> Array:
    """The corners of the boxes from which ``drawn_around`` draws, (16 target, 4)."""
    return drawn_around(centre, spread, np.array(list(product((0.0, 1.0), repeat=4)))[:, None]).reshape(-1, 4)


def target_fields(targets: int, sensors: int) -> tuple[ObservationField, ...]:
    """Observation fields: time left, and of every target the prediction at the next pulse, also at each sensor."""
    listed = [ObservationField("time_left", "1", 0.5, 0.3, "fraction of the horizon still to come")]
    for t in range(1, targets + 1):
        of, present = f"of target {t} at the next pulse", f"whether target {t} is present at the next pulse"
        listed += [
            ObservationField(f"present_{t}", "1", 0.5, 0.5, f"{present}; else its other fields are 0"),
            ObservationField(f"log10_sigma_position_{t}", "log10(m)", 1.0, 1.0, f"RMS position uncertainty {of}"),
            ObservationField(f"log10_sigma_velocity_{t}", "log10(m/s)", 0.5, 0.5, f"RMS velocity uncertainty {of}"),
        ]
        for i in range(1, sensors + 1):
            at, where = f"{t}_{i}", f"{of}, at sensor {i}"
            listed += [
                ObservationField(f"snr_{at}", "dB", 19.0, 3.0, f"eta {where}"),
                ObservationField(f"log10_sigma_r_{at}", "log10(m)", 0.5, 0.5, f"standard deviation of range {where}"),
                ObservationField(
                    f"log10_sigma_rdot_{at}", "log10(m/s)", 0.5, 0.5, f"standard deviation of range-rate {where}"
                ),
                ObservationField(f"correlation_{at}", "1", 0.0, 0.5, f"correlation of range and range-rate {where}"),
            ]
    return tuple(listed)


def sensor_fields(targets: int, sensor: int) -> tuple[str, ...]:
    """The names of the observation fields at one sensor, counted from 1."""
    return tuple(f"{name}_{t}_{sensor}" for t in range(1, targets + 1) for name in AT_SENSOR)


def greatest_gate_volume(
    mean: Array, P: Array, sensors: ArrayLike, C: Array, law: tuple[float, float], gate: float
) -> float:
    """Area in m (m/s) of the largest validation gate, over targets and sensors.

    The measurement noise is that at three standard deviations of position beyond the estimate.

    Args:
        mean: estimated [x y xdot ydot] of each target, (target, 4).
        P: covariance of all estimates, (4, 4).
        sensors: positions, (sensor, 2).
        C: measurement covariances of all waveforms at unit SNR, (waveform, 2, 2).
        law: reference and nearest range of the SNR, m.
        gate: radius in standard deviations.
    """
    places = np.asarray(sensors)[:, None]
    H = range_and_rate_jacobian(mean, places)  # (sensor, target, 2, 4)
    farthest = range_and_rate(mean, places)[..., 0] + 3.0 * np.sqrt(P[0, 0] + P[1, 1])
    eta = range_law_snr(farthest, *law)
    S = (H @ P @ np.swapaxes(H, -1, -2))[:, :, None] + C / eta[..., None, None, None]
    return float(gate_volume(S, gate).max())
