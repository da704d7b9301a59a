"""Gaussian-mixture tracking of several targets in clutter: the update of one step, for one environment.

In clutter the exact belief about a target is a mixture: one Gaussian for each history of associations. Each scan
multiplies the histories by the returns in their gates. The tracker keeps at most C components for each target:

1. Every component predicts its own measurement (unscented transform) and opens its own gate.
2. Each target's likelihood of a return is the sum over its components. The joint association of all targets is exact
   (``joint_association``): a return belongs to one target at most.
3. Every component branches: a hypothesis for each return in its gate, and one for the miss. Hypotheses of negligible
   weight are merged with the miss of their parent, as in probabilistic data association: nothing is pruned.
4. The hypotheses are merged to at most C components, in order of decreasing weight. Each one joins the component with
   the lowest cost of merging, by Runnalls's bound on the Kullback-Leibler divergence. It does so only if this cost is
   negligible or no place is free; otherwise it becomes a component.

Merging preserves the mean and the covariance of the mixture. So the covariance of the belief includes hypotheses that
disagree, and an unlikely hypothesis adds cost until the scans refute it. With one component the tracker is JPDA. With
one target and as many components as histories it is the exact Bayes filter, except for the unscented transform. Between
scans the targets are independent: the dependence of targets that shared returns in earlier scans is neglected, as in
JPDA. There are no random numbers.

References: Salmond, *Mixture reduction algorithms for target tracking in clutter*, SPIE 1305 (1990); Pao, *Multisensor
multitarget mixture reduction algorithms for tracking*, Journal of Guidance, Control, and Dynamics 17 (1994), for
several targets; Runnalls, *Kullback-Leibler approach to Gaussian mixture reduction*, IEEE Transactions on Aerospace and
Electronic Systems 43 (2007), for the cost of a merger.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wavegym.core.arrays import FloatArray, check_finite
from wavegym.core.covariances import check_positive_definite
from wavegym.core.errors import InputError, check_int, check_non_negative
from wavegym.trackers import gaussian_mixture_kernels as kernels
from wavegym.trackers.association import (
    check_array,
    check_association_terms,
    check_distribution,
    check_scans,
    raise_without_evidence,
)

STATES = 4  # [x y xdot ydot]
SIZES = (0,) * STATES


class GaussianMixture(NamedTuple):
    """The belief about each target. The components in use come first; the others have the weight 0."""

    weight: FloatArray  # (..., target, component), sum 1 over the components
    mean: FloatArray  # (..., target, component, 4)
    covariance: FloatArray  # (..., target, component, 4, 4)


class MixtureUpdate(NamedTuple):
    """The result of ``mixture_update``."""

    mean: FloatArray  # (target, 4), of the mixture
    covariance: FloatArray  # (target, 4, 4), of the mixture
    mixture: GaussianMixture  # with (target, component) axes
    log_evidence: float  # log likelihood of all scans relative to clutter alone


def single_gaussian(mean: ArrayLike, covariance: ArrayLike, components: int) -> GaussianMixture:
    """The mixture that begins with one Gaussian for each target.

    Args:
        mean: (..., target, n).
        covariance: (..., target, n, n).
        components: places for components of each target, >= 1.

    Raises:
        InputError: no place, shapes that do not fit, means that are not finite, or covariances that are not positive
            definite.
    """
    x, P, most = np.asarray(mean), np.asarray(covariance), check_int("components", components, 1)
    if x.ndim < 2 or P.shape != (*x.shape, x.shape[-1]):
        raise InputError(
            f"mean and covariance have the shapes {x.shape} and {P.shape}, expected (..., target, n), (..., n)"
        )
    x, P = check_finite("mean", x), check_positive_definite("covariance", P)
    lead = (*x.shape[:-1], most)
    mixture = GaussianMixture(np.zeros(lead), np.zeros(lead + x.shape[-1:]), np.zeros(lead + P.shape[-2:]))
    mixture.weight[..., 0], mixture.mean[..., 0, :], mixture.covariance[..., 0, :, :] = 1.0, x, P
    return mixture


def mixture_update(
    mixture: GaussianMixture,
    measurements: Sequence[ArrayLike],
    pd: ArrayLike,
    noise: ArrayLike,
    sensors: ArrayLike,
    clutter_density: float,
    gate: float = math.inf,
    gate_probability: float = 1.0,
    negligible: float = kernels.NEGLIGIBLE,
) -> MixtureUpdate:
    """Update each target's mixture with one scan of every sensor: range and range-rate, in m and m/s.

    The sensors are processed in sequence. Start with ``single_gaussian``. Between steps predict all components:
    ``wavegym.trackers.predict`` broadcasts.

    Args:
        mixture: predicted components [x y xdot ydot] of each target, with (target, component) axes, in m and m/s.
        measurements: for each sensor (r, rdot), (measurement, 2): all returns in the gates of all components.
        pd: detection probabilities, (sensor, target), in (0, 1).
        noise: measurement covariances, (sensor, target, 2, 2).
        sensors: positions, (sensor, 2), in m.
        clutter_density: false returns per m x m/s, > 0.
        gate: radius of each component's gate in standard deviations; inf: no gates.
        gate_probability: probability that a detected target's return lies in its component's gate.
        negligible: limit of merging. A hypothesis with a weight below ``negligible`` / C is merged into its parent's.
            Components whose merge costs at most ``negligible`` / C nats are merged even if there is room. 0 merges
            none.

    Returns:
        See ``MixtureUpdate``.

    Raises:
        InputError: an invalid shape or value, or more than ten targets that share measurements.
    """
    own = _check_mixture(mixture)
    targets = len(own.weight)
    scans, Pd, N, place = check_scans(measurements, pd, noise, sensors, targets)
    check_association_terms(Pd, clutter_density, gate_probability)
    if not gate > 0.0:
        raise InputError(f"gate is {gate!r}, expected a number > 0 (inf: no gates)")
    if N.size:
        check_positive_definite("noise", N)
    check_non_negative("negligible", negligible)
    numbers = float(gate), float(gate_probability), float(clutter_density), float(negligible)
    log_evidence = _update_in_place(own, scans, Pd, N, place, numbers)
    mean, covariance = np.empty((targets, STATES)), np.empty((targets, STATES, STATES))
    kernels.moments(tuple(own), np.ones(targets, np.bool_), mean, covariance, SIZES)
    return MixtureUpdate(mean, covariance, own, log_evidence)


def _update_in_place(
    own: GaussianMixture,
    scans: list[FloatArray],
    pd: FloatArray,
    noise: FloatArray,
    sensors: FloatArray,
    numbers: tuple[float, float, float, float],
) -> float:
    """Overwrite ``own`` sensor after sensor; return the log evidence. ``numbers``: gate to negligible."""
    targets, most = own.weight.shape
    lit, opened, log_evidence = np.ones(targets, np.bool_), np.empty(targets * most, np.bool_), 0.0
    bank = kernels.workspace(targets * most, SIZES)
    leaves = tuple(own)  # as AgileClutter's kernels pass them: no other version is compiled
    for i, z in enumerate(scans):
        kernels.predict_bank(leaves, lit, noise[i], sensors[i, 0], sensors[i, 1], bank, opened, SIZES)
        log_evidence += kernels.update_mixtures(lit, leaves, z, len(z), pd[i], bank, *numbers, SIZES)
        if not np.isfinite(log_evidence):
            raise_without_evidence(i, targets, numbers[2])
    return float(log_evidence)


def _check_mixture(mixture: GaussianMixture) -> GaussianMixture:
    """A copy of the mixture; otherwise raise an InputError."""
    weight = check_array("weight", mixture[0], (None, None))
    check_distribution("weight", weight, "a row of ")
    used = weight > 0.0
    if not used[:, :1].all() or (used[:, 1:] > used[:, :-1]).any():
        raise InputError("weight has a component after a free place, expected the components in use first")
    mean = check_array("mean", mixture[1], (*weight.shape, STATES))
    covariance = check_array("covariance", mixture[2], (*mean.shape, STATES))
    if used.any():
        check_positive_definite("covariance", covariance[used])
    return GaussianMixture(weight, mean, covariance)
