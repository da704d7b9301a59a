"""What schedulers can do faster in Kershaw and Evans's loop, and a step in compiled form."""

from __future__ import annotations

import math

import numpy as np

from wavegym.core import shortcuts
from wavegym.core.arrays import Array
from wavegym.core.horizon_weights import LinearCost
from wavegym.core.shortcuts import MeasuredFields, Recursion
from wavegym.core.system import ObservationField, State
from wavegym.sensors import range_law_snr
from wavegym.systems.kershaw_evans import kernels
from wavegym.systems.kershaw_evans.actions import Pulses
from wavegym.systems.kershaw_evans.state import Belief, Measurements, Truth, World
from wavegym.systems.kershaw_evans.system import MEASURED, KershawEvans
from wavegym.trackers import predict


@shortcuts.fused_transition.register(KershawEvans)
def fused_transition(system: KershawEvans, state: State, action: Array, world: World) -> State:
    """One pulse: predict, measure at the true range, update; by its parts without the compiled Kalman filter."""
    if system._given_tracker:
        return system.composed_transition(state, action, world)
    (_, path), (step, mean, covariance, *_) = state
    is_cut = system.library and system.eclipsing
    pulses = _cut_pulses(system, action, path, step) if is_cut else system.action_set.pulses(action)
    x, P, truth, ahead = np.empty(mean.shape), np.empty(covariance.shape), np.empty(mean.shape), np.empty_like(step)
    kernels.transition(
        mean, covariance, step, path, world.normal, *pulses, system.truth_model._snr_law, *system._assumed,
        x, P, truth, ahead
    )  # fmt: skip
    return State(Truth(truth, path), Belief(ahead, x, P))


def _cut_pulses(system: KershawEvans, action: Array, path: Array, step: Array) -> Pulses:
    """The visible part of the given pulses of a step; tables give the cut."""
    each = np.arange(len(step))
    ahead = np.minimum(step + 1, system.horizon)  # past the end of an episode the result is not used
    return Pulses(system._covariance_from(action, path[each, ahead, 0]), np.ones(len(each)), each, -math.inf)


@shortcuts.best_sequence.register(KershawEvans)
def best_sequence(system: KershawEvans, belief: Belief, depth: int) -> tuple[Array, Array]:
    """Fused search over all sequences of ``depth`` candidates: first candidate (env,) and total cost (env,)."""
    ranges = system._ranges_ahead(belief, depth)
    C = _covariances_along(system, ranges)
    return kernels.lookahead(
        belief.mean, belief.covariance, C, ranges, belief.step, system.horizon, system._weights, *system._radar(belief)
    )


@shortcuts.deterministic_recursion.register(KershawEvans)
def deterministic_recursion(system: KershawEvans, world: World) -> Recursion:
    """The covariance recursion of whole episodes: with eta at the true range it depends on actions alone.

    Raises:
        NotImplementedError: another tracker than the Kalman filter.
    """
    if system._given_tracker:
        raise NotImplementedError
    state = system.initial(world)
    ranges = state.truth.path[:, 1:, 0]
    eta = range_law_snr(abs(ranges), *system._snr_law)[..., None, None, None]
    F, Q, M = system._model
    R = _covariances_along(system, ranges) * (1.0 / eta)
    return Recursion(state.belief.covariance, F[0], Q[0], M[0], R, system._weights)


def _covariances_along(system: KershawEvans, ranges: Array) -> Array:
    """C of all candidates at ranges (env, step), (env or 1, step or 1, candidate, 2, 2)."""
    C = system.action_set.received_covariance(system.candidates()[None], ranges.reshape(-1))
    return C.reshape(*(ranges.shape if len(C) > 1 else (1, 1)), *C.shape[1:])


@shortcuts.linear_cost.register(KershawEvans)
def linear_cost(system: KershawEvans) -> LinearCost:
    """The state of the single target."""
    return LinearCost(system.motion.F, system.weights)


@shortcuts.next_pulse.register(KershawEvans)
def next_pulse(system: KershawEvans, belief: Belief) -> tuple[Array, Array]:
    """Predicted covariance (env, n, n), and eta at the predicted range (env,), at the next pulse."""
    F, Q, *_ = system._radar(belief)
    mean, P = predict(belief.mean, belief.covariance, F, Q)
    return P, range_law_snr(abs(mean[:, 0]), system.reference_range, system.nearest_range)


@shortcuts.innovation_covariance.register(KershawEvans)
def innovation_covariance(system: KershawEvans, belief: Belief, actions: Array) -> Array:
    """S = H P H' + R one step ahead, (env, candidate, 2, 2), for actions (env or 1, candidate)."""
    P, eta = next_pulse(system, belief)
    return P[:, None, :MEASURED, :MEASURED] + system._predicted_covariance(belief, actions) / eta[:, None, None, None]


@shortcuts.measured_fields.register(KershawEvans)
def measured_fields(system: KershawEvans) -> MeasuredFields:
    """Range and range-rate of the last pulse."""
    near, far = system.start_range
    return MeasuredFields(
        (
            ObservationField("range", "m", 0.5 * (near + far), max(0.5 * (far - near), 1.0), "last measured range"),
            ObservationField(
                "signed_log10_rate", "log10(m/s)", 0.0, 1.5, "sign(v) log10(1 + |v|), v the last measured range-rate"
            ),
        ),
        _measured_values,
    )


def _measured_values(measurements: Measurements) -> Array:
    rate = measurements.z[:, 1]  # short pulses err by kilometres a second
    return np.stack([measurements.z[:, 0], np.sign(rate) * np.log10(1.0 + abs(rate))], axis=1)
