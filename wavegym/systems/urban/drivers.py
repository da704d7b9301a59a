"""How a driver leaves the route: random accelerations push the target off, and the driver steers back."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from wavegym.core.arrays import Array

RETURN = 0.3  # rad/s, natural frequency at which the driver returns to the route
DAMPING = 0.7  # of this motion, as a fraction of the critical damping


def deviation_model(dt: float) -> tuple[Array, Array]:
    """F (2, 2) and g (2,) of the deviation (p, v) from the route on each axis: (p, v)' = F (p, v) + g a.

    The random acceleration ``a`` is constant during a step of ``dt`` s. Exact for any step: the exponential of the
    oscillator v' = a - 2 DAMPING RETURN v - RETURN^2 p. With sigma = 0.25 m/s^2 and steps of 0.25 s the deviation has
    standard deviations of 0.45 m and 0.14 m/s.
    """
    rates = np.array([[0.0, 1.0, 0.0], [-(RETURN**2), -2.0 * DAMPING * RETURN, 1.0], [0.0, 0.0, 0.0]])
    step = scipy.linalg.expm(dt * rates)
    return step[:2, :2].copy(), step[:2, 2].copy()
