"""Discrete-time models of manoeuvring targets in the plane: constant velocity, coordinated turn, constant acceleration.

All models but ``constant_turn`` share the state x = (x, y, xdot, ydot, xddot, yddot): an interacting multiple model
filter can mix them.

Reference: Barbosa et al., *Controlled tracking in urban terrain*, section 3.3, after Li and Jilkov's survey (2003). The
paper orders the state [x xdot y ydot xddot yddot]. Its printed noise has twelve rows; G diag(s², s²) G' is meant.
"""

from __future__ import annotations

import math

import numpy as np

from wavegym.core.arrays import FloatArray
from wavegym.core.errors import InputError, check_non_negative, check_positive
from wavegym.targets.motion import MotionModel, constant_velocity

NAMES = ("x", "y", "xdot", "ydot", "xddot", "yddot")


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


def nearly_constant_acceleration(dt: float, sigma: float) -> MotionModel:
    """NCA (Wiener sequence): the acceleration changes by white steps of standard deviation ``sigma``.

    Args:
        dt: step [s].
        sigma: standard deviation of the change of acceleration per step on each axis [m/s²].

    Raises:
        InputError: dt not > 0, or a negative standard deviation.
    """
    T = check_positive("dt", dt, "s")
    F = np.kron(np.array([[1.0, T, T * T / 2], [0.0, 1.0, T], [0.0, 0.0, 1.0]]), np.eye(2))
    G = np.kron([[T * T / 2], [T], [1.0]], np.eye(2))
    return MotionModel(F, check_non_negative("sigma", sigma) ** 2 * (G @ G.T), NAMES)


def _turning(dt: float, turn_rate: float, sigma: float, acceleration: float) -> MotionModel:
    T = check_positive("dt", dt, "s")
    F = np.zeros((6, 6))
    F[:2, :2] = np.eye(2)
    F[:2, 2:4], F[2:4, 2:4] = _turn(T, turn_rate)
    G = np.kron([[T * T / 2], [T], [0.0]], np.eye(2))
    Q = check_non_negative("sigma", sigma) ** 2 * (G @ G.T)
    Q[4:, 4:] += check_non_negative("acceleration", acceleration) ** 2 * np.eye(2)
    return MotionModel(F, Q, NAMES)


def _turn(dt: float, turn_rate: float) -> tuple[FloatArray, FloatArray]:
    """Displacement and new velocity after ``dt`` seconds as matrices on the velocity (xdot, ydot), (2, 2) each."""
    if not math.isfinite(turn_rate):
        raise InputError(f"turn_rate is {turn_rate!r}, expected a finite number [rad/s]")
    angle = turn_rate * dt
    c, s = math.cos(angle), math.sin(angle)
    along = dt if angle == 0.0 else s / turn_rate  # ∫ cos(ω t) dt
    aside = 0.0 if angle == 0.0 else 2.0 * math.sin(angle / 2.0) ** 2 / turn_rate  # ∫ sin(ω t) dt
    return np.array([[along, -aside], [aside, along]]), np.array([[c, -s], [s, c]])
