"""The recursion of a covariance that does not depend on the measurements."""

from __future__ import annotations

from typing import NamedTuple

from wavegym.core.arrays import Array


class Recursion(NamedTuple):
    """The Riccati recursion of each environment to the episode's end: a linear model, Pd = 1 and a known SNR.

    At step k + 1 action a measures with covariance R[env, k, a]; the cost of a step is sum_i weights[i] P_ii.
    """

    covariance: Array  # (env, n, n) P0, positive definite
    F: Array  # (n, n)
    Q: Array  # (n, n)
    M: Array  # (m, n) measurement matrix
    R: Array  # (env, H, A, m, m) measurement covariances at steps 1 ... H, in the order of ``candidates``
    weights: Array  # (n,)
