"""What schedulers can do faster, or further, in a shared band."""

from __future__ import annotations

from typing import Any

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.shortcuts import MeasuredFields, SensedBand
from wavegym.core.system import ObservationField, State
from wavegym.systems.shared_spectrum import kernels
from wavegym.systems.shared_spectrum import prediction_kernels as prediction
from wavegym.systems.shared_spectrum.state import Belief, Measurements, World
from wavegym.systems.shared_spectrum.system import SharedSpectrum


@shortcuts.fused_transition.register(SharedSpectrum)
def fused_transition(system: SharedSpectrum, state: State, action: Array, world: World) -> State:
    """One step in compiled form."""
    if system._own:
        return system.composed_transition(state, action, world)
    (truth, belief), action = state, system.band_of(action)
    count = len(belief.step)
    targets, places, taken = np.empty_like(truth.targets), np.empty_like(truth.places), np.empty_like(truth.taken)
    noise, collisions = np.empty_like(truth.noise), np.empty_like(truth.collisions)
    mean, covariance, struck = np.empty_like(belief.mean), np.empty_like(belief.covariance), np.empty(count)
    late, heard, sent, level = truth.late.copy(), belief.heard.copy(), belief.sent.copy(), belief.level.copy()
    kernels.transition(
        belief.step, action, truth.path, truth.users, truth.places, truth.taken, truth.noise, late, world.key,
        world.normal, world.sensing, system.history, system.truth_model._radar, belief.mean, belief.covariance,
        system._radar, system._band, targets, places, taken, noise, collisions, mean, covariance, heard, sent, level,
        struck,
    )  # fmt: skip
    after = truth._replace(targets=targets, places=places, taken=taken, noise=noise, late=late, collisions=collisions)
    return State(after, Belief(belief.step + 1, mean, covariance, heard, sent, level, struck))


@shortcuts.best_action.register(SharedSpectrum)
def best_action(system: SharedSpectrum, belief: Belief) -> Array:
    """The band of least expected cost under the predicted occupancy, without the beliefs after it."""
    return system.candidates()[least_cost(system, belief, system.occupancy(belief), belief.level).argmin(axis=1)]


def least_cost(
    system: SharedSpectrum, belief: Belief, probability: Array, level: Array, priced: Array | None = None
) -> Array:
    """Expected cost (env, band) if channels are occupied with this probability, at this noise, (env, channel).

    priced: probability that an own channel has its price, where it is not ``probability``.
    """
    count, bands = len(belief.step), len(system.bands.width)
    x, P = np.empty((count, bands, 2)), np.empty((count, bands, 2, 2))
    candidates = np.broadcast_to(np.arange(bands), (count, bands))
    prediction.expected(
        belief.mean, belief.covariance, probability, level, candidates, system._radar, system._band, x, P
    )
    cost: Array = P[..., 0, 0] * system.weights[0] + P[..., 1, 1] * system.weights[1]
    if system.price:
        occupied = probability if priced is None else priced
        cost += system.price * (occupied[:, None] * system.held).sum(axis=2)
    return cost


@shortcuts.sensed_band.register(SharedSpectrum)
def sensed_band(system: SharedSpectrum) -> SensedBand:
    """The noise heard, and the bands."""

    def noise(belief: Belief, steps: int) -> Array:
        last = system.history + belief.step - system.sensing_delay - 1
        rows = last[:, None] - np.arange(steps)
        heard = 10.0 ** (0.05 * belief.heard[np.arange(len(last))[:, None], np.maximum(rows, 0)])
        return np.where(rows[..., None] >= 0, heard, np.nan)

    def last(belief: Belief) -> Array:
        return belief.sent[np.arange(len(belief.step)), np.maximum(belief.step - 1, 0)].astype(np.int64)

    def cost(belief: Belief, probability: Array) -> Array:
        return least_cost(system, belief, probability, belief.level)

    return SensedBand(system.held, kernels.BUSY_NOISE, noise, last, cost)


@shortcuts.measured_fields.register(SharedSpectrum)
def measured_fields(system: SharedSpectrum) -> MeasuredFields:
    """Whether the last train found the target, its range and range-rate, and the noise measured in every channel."""
    (near, far), fastest = system.start_range, max(map(abs, system.start_speed))
    centre, scale = 0.5 * (near + far), max(0.5 * (far - near), 1.0)
    fields = (
        ObservationField("detected", "1", 0.5, 0.5, "whether the target was detected"),
        ObservationField("range", "m", centre, scale, "measured range"),
        ObservationField("range_rate", "m/s", 0.0, max(fastest, 1.0), "measured range-rate"),
        *(
            ObservationField(
                f"noise_{c}", "dB", 10.0, 10.0, f"measured {1 + system.sensing_delay} steps ago in channel {c}"
            )
            for c in range(system.channels)
        ),
    )
    missing = np.array([centre, 0.0])

    def values(measurements: Measurements) -> Array:
        found = measurements.present[:, None]
        decibels = 10.0 * np.log10(measurements.known)
        return np.concatenate([found, np.where(found, measurements.z, missing), decibels], axis=1)

    return MeasuredFields(fields, values)


@shortcuts.named_constants.register(SharedSpectrum)
def named_constants(system: SharedSpectrum) -> dict[str, Array]:
    """The whole spectrum."""
    return {"full-band": np.asarray(system.candidates()[system.bands.width.argmax()])}


@shortcuts.baselines.register(SharedSpectrum)
def baselines(system: SharedSpectrum) -> dict[str, tuple[str, dict[str, Any]]]:
    """The one-step scheduler, and a planner, with other predictors of the occupancy."""
    return {
        "myopic:counts": ("myopic", {"predictor": "counts"}),
        "myopic:reactions": ("myopic", {"predictor": "reactions"}),
        "myopic:lags": ("myopic", {"predictor": "lags:10"}),
        "myopic:stepped": ("myopic", {"predictor": "stepped:10"}),
        "myopic:context-tree": ("myopic", {"predictor": "context-tree:8"}),
        "rollout:lags": ("rollout:4@myopic", {"predictor": "lags:10"}),
    }
