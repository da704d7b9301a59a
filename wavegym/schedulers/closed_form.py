"""The one-step optimum over Kershaw and Evans's box: duration k and signed chirp rate g of a Gaussian chirp.

With A = H P H' at the next pulse the innovation covariance is S = A + R. In terms of k and the sweep s = 2 k g / pi,

    eta R = [[c^2 k^2 / 2, -c^2 pi s k / (2 wc)], [., (c / wc)^2 (1 / (2 k^2) + pi^2 s^2 / 2)]],   wc = 2 pi fc,

has the same determinant c^4 / (4 wc^2) everywhere, and for any symmetric X

    q_X(k, s) = eta tr(adj(X) R) = X22 c^2 k^2 / 2 + X12 c^2 pi s k / wc + X11 (c / wc)^2 (1 / k^2 + pi^2 s^2) / 2.

*Gate volume.* det S = det A + det R + q_A / eta, so q_A is minimised. Without limits R is then proportional to A (the
eigenvalues of R A^-1 have a fixed product, and the least sum where they are equal): k^2 = A11 / (wc sqrt(det A)) and g
= -wc A12 / (2 A11). This is the solution only if it is inside the box. On the box q_A is convex, because it is a
positive definite quadratic form of (k, s) plus a multiple of 1 / k^2. Hence the best sweep for each k is -wc A12 k /
(pi A11), or the limit if this is beyond it. The best duration is the k above. If its sweep is beyond the limit, the
best duration is the only positive root of a quartic on that edge. It is clipped to the limits on the duration.

*Trace.* With G = P H' A^-1 the update leaves P - G A G' + G U G', where U = A - A S^-1 A = (det A R + det R A) / det S,
a sum without cancellation. So tr(Lambda P) is a constant plus, with L = G' Lambda G, the ratio of
det A tr(L R) + det R tr(L A) to det S: for a given k a ratio of two quadratics in s, extremal at the roots of a third
and at the limits. The duration is searched.

Source of the form of R, of R proportional to A and of the quadratic in the chirp rate: D. J. Kershaw and R. J. Evans,
"Optimal waveform selection for tracking systems", IEEE Trans. Information Theory 40(5), 1994. The edges of the box, the
form without cancellation and the search over durations are derived here.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np

from wavegym.core.action_sets import ParameterBox
from wavegym.core.arrays import Array
from wavegym.core.errors import InputError, check_choice
from wavegym.core.shortcuts import next_pulse
from wavegym.core.system import System
from wavegym.waveforms import SPEED_OF_LIGHT

GRID = 65  # durations of the first grid
FINER, ROUNDS = 17, 5  # durations of each finer grid between the best one's neighbours; number of finer grids
NEWTON = 8  # steps; the start is never far from the root


class Limits(NamedTuple):
    """The bounds of the box."""

    shortest: float  # s
    longest: float  # s
    sweep: float  # Hz, of either sign


class Quadratic(NamedTuple):
    """square s^2 + linear s + constant, (...)."""

    square: Array
    linear: Array
    constant: Array

    def __call__(self, s: Array) -> Array:
        """The value at s."""
        return (self.square * s + self.linear) * s + self.constant


def weighted_error(X: Array, k: Array, carrier_hz: float) -> Quadratic:
    """q_X of the sweep, at durations k (...); X is (..., 2, 2)."""
    c2, ratio = SPEED_OF_LIGHT**2, 1.0 / (2.0 * np.pi * carrier_hz)
    k2 = k * k
    spread = 0.5 * c2 * ratio * ratio * X[..., 0, 0]
    constant = 0.5 * c2 * X[..., 1, 1] * k2 + spread / k2
    return Quadratic(spread * np.pi**2 + 0.0 * k, c2 * np.pi * ratio * X[..., 0, 1] * k, constant)


def smallest_gate(A: Array, limits: Limits, carrier_hz: float) -> tuple[Array, Array]:
    """Duration (env,) and sweep (env,) with the least det(A + R), A (env, 2, 2)."""
    one = weighted_error(A, np.ones(len(A)), carrier_hz)
    tilt = -0.5 * one.linear / one.square  # the best sweep is tilt k
    fall = one.square / np.pi**2  # q_A has the terms fall / k^2
    rise = one.constant - fall  # and rise k^2
    k = np.sqrt(np.sqrt(fall / (rise - one.square * tilt * tilt)))
    # On the edge 2 rise k - push - 2 fall / k^3 = 0: increasing and concave, so Newton's steps from below stay below.
    push = np.abs(one.linear) * limits.sweep
    edge = np.maximum(np.sqrt(np.sqrt(fall / rise)), 0.5 * push / rise)
    for _ in range(NEWTON):
        cubed = fall / (edge * edge * edge)
        edge = edge - (rise * edge - 0.5 * push - cubed) / (rise + 3.0 * cubed / edge)
    k = np.where(np.abs(tilt * k) <= limits.sweep, k, edge).clip(limits.shortest, limits.longest)
    return k, (tilt * k).clip(-limits.sweep, limits.sweep)


def least_trace(P: Array, eta: Array, weights: Array, limits: Limits, carrier_hz: float) -> tuple[Array, Array]:
    """Duration (env,) and sweep (env,) with the least trace(Lambda P) after the update, P (env, n, n) predicted."""
    A, eta = P[:, None, :2, :2], eta[:, None]
    det_A = A[..., 0, 0] * A[..., 1, 1] - A[..., 0, 1] * A[..., 0, 1]
    det_R = 0.25 * SPEED_OF_LIGHT**4 / (2.0 * np.pi * carrier_hz) ** 2 / (eta * eta)
    L = np.diag(weights[:2]) + np.zeros_like(A)
    for i in range(2, len(weights)):  # states that are not measured: by regression on those that are
        slope = np.linalg.solve(A, P[:, None, :2, i, None])
        L += weights[i] * slope * np.swapaxes(slope, -1, -2)
    adjugate = np.trace(L, axis1=-2, axis2=-1)[..., None, None] * np.eye(2) - L
    apart = eta * det_R * (L * A).sum(axis=(-2, -1))  # numerator and denominator are multiplied by eta
    volume = eta * (det_A + det_R)

    def best_sweep(k: Array) -> tuple[Array, Array]:
        error, size = weighted_error(adjugate, k, carrier_hz), weighted_error(A, k, carrier_hz)
        over = Quadratic(det_A * error.square, det_A * error.linear, det_A * error.constant + apart)
        return _least_ratio(over, size._replace(constant=size.constant + volume), limits.sweep)

    k = np.repeat(np.geomspace(limits.shortest, limits.longest, GRID)[None], len(P), axis=0)
    rows = np.arange(len(P))
    for _ in range(ROUNDS):
        best = best_sweep(k)[1].argmin(axis=1)
        low, high = k[rows, np.maximum(best - 1, 0)], k[rows, np.minimum(best + 1, k.shape[1] - 1)]
        k = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, FINER)
    sweeps, traces = best_sweep(k)
    best = traces.argmin(axis=1)
    return k[rows, best], sweeps[rows, best]


def _least_ratio(over: Quadratic, under: Quadratic, limit: float) -> tuple[Array, Array]:
    """Minimiser of over / under in [-limit, limit], and the minimum; under > 0."""
    a = over.square * under.linear - over.linear * under.square
    half = over.square * under.constant - over.constant * under.square
    c = over.linear * under.constant - over.constant * under.linear
    root = np.sqrt(np.maximum(half * half - a * c, 0.0))
    w = -(half + np.copysign(root, half))  # the sum without cancellation; the other root follows from their product
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = np.nan_to_num(np.stack([w / a, c / w], axis=-1)).clip(-limit, limit)
    s = np.concatenate([roots, np.full_like(roots, limit) * [-1.0, 1.0]], axis=-1)
    over, under = (Quadratic(*(term[..., None] for term in q)) for q in (over, under))
    ratio = over(s) / under(s)
    best = ratio.argmin(axis=-1)[..., None]
    return np.take_along_axis(s, best, -1)[..., 0], np.take_along_axis(ratio, best, -1)[..., 0]


class MyopicClosedForm:
    """The best point of the box one step ahead, for systems with Kershaw and Evans's box of duration and sweep.

    Args:
        objective: "trace" (of Lambda P after the update) or "gate" (volume of the validation gate).

    Raises:
        InputError: an unknown objective.
    """

    def __init__(self, objective: str = "trace") -> None:
        self.objective = check_choice("objective", objective, ("trace", "gate"))

    def begin(self, system: System, num_envs: int, rng: np.random.Generator) -> None:
        """See ``Policy``. Raises an InputError for any other action set, or with eclipsing."""
        box = system.actions
        if not (isinstance(box, ParameterBox) and box.names == ("duration", "sweep") and next_pulse.of(system)):
            wanted = "expected Kershaw and Evans's box of duration and sweep (nearest: action='box')"
            raise InputError(f"policy 'myopic:closed-form' is not for {type(system).__name__} in this form, {wanted}")
        if cast(Any, system).eclipsing:
            raise InputError(
                "policy 'myopic:closed-form' is for whole pulses, expected a system without eclipsing (nearest: "
                "eclipsing=False)"
            )
        duration, sweep = box.parameters
        self._system: Any = system
        self._box, self._limits = box, Limits(duration.low, duration.high, sweep.high)

    def act(self, belief: Any, observation: Array | None, mask: Array | None) -> Array:
        """See ``Policy``. Actions (env, 2) in [-1, 1]."""
        system, limits = self._system, self._limits
        P, eta = next_pulse(system, belief)
        if self.objective == "gate":
            chosen = smallest_gate(P[:, :2, :2], limits, system.carrier_hz)
        else:
            chosen = least_trace(P, eta, system.weights, limits, system.carrier_hz)
        return self._box.encode(np.stack(chosen, axis=1))
