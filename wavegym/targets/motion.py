"""Linear motion models driven by white noise, random paths drawn from them, and models of manoeuvres in the plane.

All models of manoeuvres except ``constant_turn`` share the state x = (x, y, xdot, ydot, xddot, yddot): an interacting
multiple model filter can mix them. Reference: Barbosa et al., *Controlled tracking in urban terrain*, section 3.3,
after Li and Jilkov's survey (2003). The paper orders the state [x xdot y ydot xddot yddot]. Its printed noise has
twelve rows; G diag(s², s²) G' is meant.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import Array, FloatArray, check_finite, for_kernel
from wavegym.core.covariances import check_covariance
from wavegym.core.errors import InputError, check_choice, check_int, check_non_negative, check_positive
from wavegym.targets.kernels import scan, scan_batch

SUFFIXES = ("", "dot", "ddot")
MANOEUVRE_NAMES = ("x", "y", "xdot", "ydot", "xddot", "yddot")


@dataclass(frozen=True, eq=False)
class MotionModel:
    """x_{k+1} = F x_k + v_k with v_k ~ N(0, Q).

    Args:
        F: transition matrix, (n, n).
        Q: process noise covariance, symmetric and positive semidefinite: (n, n), or (..., n, n) where each target has a
            process noise of its own.
        names: one name per state component, such as ``("r", "rdot")``.

    Raises:
        InputError: shapes that do not fit, entries that are not finite, repeated names, or a Q that is no covariance.
    """

    F: FloatArray
    Q: FloatArray
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        F, Q = np.array(self.F, np.float64), np.array(self.Q, np.float64)
        names, n = tuple(self.names), len(self.names)
        if n == 0 or len(set(names)) < n:
            raise InputError(f"names is {names!r}, expected different names, one per state component")
        for symbol, matrix in (("F", F), ("Q", Q)):
            own = matrix.shape[-2:] if symbol == "Q" else matrix.shape
            if own != (n, n) or not np.isfinite(matrix).all():
                raise InputError(f"{symbol} has shape {matrix.shape}, expected {(n, n)} finite numbers for {names!r}")
        for field, value in (("F", F), ("Q", Q), ("names", names)):
            object.__setattr__(self, field, value)
        check_covariance("Q", Q)

    def scaled(self, density: Array) -> MotionModel:
        """The model of targets whose process noise is ``density`` (...) times this one: its Q is (..., n, n)."""
        return replace(self, Q=density[..., None, None] * self.Q)

    @cached_property
    def noise_factor(self) -> FloatArray:
        """Lower triangular L with L Lᵀ = Q, (n, n); columns of zeros where Q is singular.

        Raises:
            InputError: a Q for each target.
        """
        if self.Q.ndim > 2:
            raise InputError(f"Q has shape {self.Q.shape}, expected {self.F.shape}: one process noise for all paths")
        return _semidefinite_cholesky(self.Q)

    @cached_property
    def _step(self) -> FloatArray:
        """[F L], (n, 2 n), the form that the kernels use."""
        return np.hstack([self.F, self.noise_factor])


def constant_velocity(dt: float, q: float, axes: Sequence[str] = ("r",), order: str = "axis") -> MotionModel:
    """Constant velocity disturbed by white acceleration (Bar-Shalom, Li and Kirubarajan 2001, section 6.2.2).

    Args:
        dt: time step [s].
        q: power spectral density of the acceleration on each axis [m²/s³].
        axes: names of the axes.
        order: ``"axis"`` for [x ẋ y ẏ], ``"derivative"`` for [x y ẋ ẏ].

    Returns:
        The model with 2 components per axis, named ``x``, ``xdot``.

    Raises:
        InputError: dt not > 0, a negative q, no axes, repeated axes, or an unknown order.
    """
    return _white_noise_model(2, dt, q, axes, order)


def constant_acceleration(dt: float, q: float, axes: Sequence[str] = ("r",), order: str = "axis") -> MotionModel:
    """Constant acceleration disturbed by white jerk (Bar-Shalom, Li and Kirubarajan 2001, section 6.2.3).

    Args:
        dt: time step [s].
        q: power spectral density of the jerk on each axis [m²/s⁵].
        axes: names of the axes.
        order: ``"axis"`` for [x ẋ ẍ y ẏ ÿ], ``"derivative"`` for [x y ẋ ẏ ẍ ÿ].

    Returns:
        The model with 3 components per axis, named ``x``, ``xdot``, ``xddot``.

    Raises:
        InputError: dt not > 0, a negative q, no axes, repeated axes, or an unknown order.
    """
    return _white_noise_model(3, dt, q, axes, order)


def random_path(
    model: MotionModel, start: ArrayLike, noise: ArrayLike | np.random.Generator, steps: int = 0
) -> FloatArray:
    """Draw true paths x_{k+1} = F x_k + L w_k, with L Lᵀ = Q.

    Args:
        model: motion model of n components.
        start: first state, (..., n).
        noise: standard normal draws w, (..., steps, n), or a Generator. The draws of a Generator do not depend on the
            model: worlds stay comparable.
        steps: number of steps; used with a Generator only.

    Returns:
        The paths with their start, (..., steps + 1, n); leading axes broadcast.

    Raises:
        InputError: an invalid shape or value.
    """
    x0 = for_kernel(check_finite("start", start))
    n = len(model.names)
    if isinstance(noise, np.random.Generator):
        check_int("steps", steps, 1)
        w = noise.standard_normal((*x0.shape[:-1], steps, n))
    else:
        w = for_kernel(check_finite("noise", noise))
    if x0.shape == (n,) and w.ndim == 2 and w.shape[1] == n:  # the common case, without broadcasting
        single: FloatArray = scan(model._step, x0, w, (0,) * n)
        return single
    if w.ndim < 2 or not x0.shape[-1:] == w.shape[-1:] == (n,):
        raise InputError(
            f"start and noise have shapes {x0.shape} and {w.shape}, expected (..., {n}), (..., steps, {n})"
        )
    try:
        lead = np.broadcast_shapes(x0.shape[:-1], w.shape[:-2])
    except ValueError as error:
        raise InputError(
            f"start and noise have shapes {x0.shape} and {w.shape}, expected leading axes that broadcast"
        ) from error
    tail = w.shape[-2:]
    starts = _spread(x0, (*lead, n)).reshape(-1, n)
    draws = _spread(w, lead + tail).reshape(len(starts), *tail)
    paths: FloatArray = scan_batch(model._step, starts, draws, (0,) * n).reshape(*lead, tail[0] + 1, n)
    return paths


def _spread(array: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """``array`` broadcast to ``shape``, for a kernel; an array of that shape is returned as it is."""
    return array if array.shape == shape else for_kernel(np.broadcast_to(array, shape))


def _white_noise_model(dim: int, dt: float, q: float, axes: Sequence[str], order: str) -> MotionModel:
    from filterpy.common import Q_continuous_white_noise

    check_positive("dt", dt, "s")
    check_non_negative("q", q)
    check_choice("order", order, ("axis", "derivative"))
    F = np.array([[1.0, dt, dt * dt / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])[:dim, :dim]
    Q = np.asarray(Q_continuous_white_noise(dim, dt=dt, spectral_density=q), np.float64)
    eye = np.eye(len(axes))
    if order == "axis":
        names = tuple(axis + suffix for axis in axes for suffix in SUFFIXES[:dim])
    else:
        names = tuple(axis + suffix for suffix in SUFFIXES[:dim] for axis in axes)
    F, Q = (np.kron(eye, block) if order == "axis" else np.kron(block, eye) for block in (F, Q))
    return MotionModel(F, Q, names)


def _semidefinite_cholesky(Q: FloatArray) -> FloatArray:
    """Lower triangular L with L Lᵀ = Q for a positive semidefinite Q; NumPy's Cholesky rejects a singular Q."""
    L = np.zeros_like(Q)
    # The rounding error of a pivot is relative to its diagonal entry, whatever the units.
    for j in range(len(Q)):
        column = Q[j:, j] - L[j:, :j] @ L[j, :j]
        if column[0] > 1e-12 * Q[j, j]:
            L[j:, j] = column / np.sqrt(column[0])
    return L


def nearly_constant_velocity(dt: float, sigma: float, acceleration: float = 0.5) -> MotionModel:
    """NCV: white acceleration of standard deviation ``sigma``, constant during each step.

    Args:
        dt: step [s].
        sigma: standard deviation of the acceleration on each axis [m/s²].
        acceleration: standard deviation of the state's acceleration components after each step [m/s²]. The model does
            not use them. The paper sets them to 0, but a covariance with a variance of 0 has no Cholesky factor.

    Raises:
        InputError: dt not > 0, or a negative standard deviation.
    """
    return _turning(dt, 0.0, sigma, acceleration)


def coordinated_turn(dt: float, turn_rate: float, sigma: float, acceleration: float = 0.5) -> MotionModel:
    """CT: the velocity turns at a known rate [rad/s], positive to the left; others as ``nearly_constant_velocity``."""
    return _turning(dt, turn_rate, sigma, acceleration)


def constant_turn(dt: float, q: float, turn_rate: float, order: str = "axis") -> MotionModel:
    """The velocity turns at a known rate, disturbed by white acceleration.

    Bar-Shalom, Li and Kirubarajan (2001), section 11.7.1. The process noise is that of ``constant_velocity``. At a turn
    rate of 0 the model is ``constant_velocity``.

    Args:
        dt: time step [s].
        q: power spectral density of the acceleration on each axis [m²/s³].
        turn_rate: [rad/s], positive to the left.
        order: ``"axis"`` for [x ẋ y ẏ], ``"derivative"`` for [x y ẋ ẏ].

    Raises:
        InputError: dt not > 0, a negative q, a turn rate that is not finite, or an unknown order.
    """
    straight = constant_velocity(dt, q, ("x", "y"), order)
    F = np.eye(4)
    F[:2, 2:], F[2:, 2:] = _turn(dt, turn_rate)
    if order == "axis":
        F = F[np.ix_((0, 2, 1, 3), (0, 2, 1, 3))]
    return MotionModel(F, straight.Q, straight.names)


def nearly_constant_acceleration(dt: float, sigma: float, push: float = 0.0) -> MotionModel:
    """NCA (Wiener sequence): the acceleration changes by white steps of standard deviation ``sigma``.

    Args:
        dt: step [s].
        sigma: standard deviation of the change of acceleration per step on each axis [m/s²].
        push: standard deviation of a white acceleration on each axis, constant during each step and forgotten after it
            [m/s²].

    Raises:
        InputError: dt not > 0, or a negative standard deviation.
    """
    T = check_positive("dt", dt, "s")
    F = np.kron(np.array([[1.0, T, T * T / 2], [0.0, 1.0, T], [0.0, 0.0, 1.0]]), np.eye(2))
    G = np.kron([[T * T / 2], [T], [1.0]], np.eye(2))
    pushed = G * [[1.0], [1.0], [1.0], [1.0], [0.0], [0.0]]
    Q = check_non_negative("sigma", sigma) ** 2 * (G @ G.T)
    Q += check_non_negative("push", push) ** 2 * (pushed @ pushed.T)
    return MotionModel(F, Q, MANOEUVRE_NAMES)


def _turning(dt: float, turn_rate: float, sigma: float, acceleration: float) -> MotionModel:
    T = check_positive("dt", dt, "s")
    F = np.zeros((6, 6))
    F[:2, :2] = np.eye(2)
    F[:2, 2:4], F[2:4, 2:4] = _turn(T, turn_rate)
    G = np.kron([[T * T / 2], [T], [0.0]], np.eye(2))
    Q = check_non_negative("sigma", sigma) ** 2 * (G @ G.T)
    Q[4:, 4:] += check_non_negative("acceleration", acceleration) ** 2 * np.eye(2)
    return MotionModel(F, Q, MANOEUVRE_NAMES)


def _turn(dt: float, turn_rate: float) -> tuple[FloatArray, FloatArray]:
    """Displacement and new velocity after ``dt`` seconds as matrices on the velocity (xdot, ydot), (2, 2) each."""
    if not math.isfinite(turn_rate):
        raise InputError(f"turn_rate is {turn_rate!r}, expected a finite number [rad/s]")
    angle = turn_rate * dt
    c, s = math.cos(angle), math.sin(angle)
    along = dt if angle == 0.0 else s / turn_rate  # ∫ cos(ω t) dt
    aside = 0.0 if angle == 0.0 else 2.0 * math.sin(angle / 2.0) ** 2 / turn_rate  # ∫ sin(ω t) dt
    return np.array([[along, -aside], [aside, along]]), np.array([[c, -s], [s, c]])
