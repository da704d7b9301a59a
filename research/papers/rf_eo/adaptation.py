"""How the settings of RF/EO platforms adapt: jumps of the PRF, pixel angles, agreement of two objectives."""

from __future__ import annotations

from typing import Any

import numpy as np

from research.papers.estimates import plain, ratio_estimates, share_estimate
from research.papers.rf_eo.study import Runs
from wavegym.core.arrays import Array
from wavegym.systems.rf_eo.system import RfEo

PRF, ANGLE = 0, 2
QUANTILES = (0.1, 0.5, 0.9)
JUMP = 2.0  # by more than this factor


def jumps(runs: Runs, start: int, seed: int) -> dict[str, Any]:
    """The share of steps from ``start`` on at which a platform's PRF changes by more than ``JUMP``.

    Keys: ``mean`` and ``ci`` of a run's share, over the steps of all platforms; ``platforms``, a list with the same
    keys for each platform.
    """
    prf = runs.settings[:, start:, :, PRF]
    change = np.maximum(prf[:, 1:] / prf[:, :-1], prf[:, :-1] / prf[:, 1:]) > JUMP
    share = change.mean(axis=1) if change.shape[1] else np.zeros((len(change), change.shape[2]))
    each = [plain(share_estimate(column, seed)) for column in share.T]
    return {**plain(share_estimate(share.mean(axis=1), seed)), "platforms": each}


def agreement(runs: Runs, seed: int) -> dict[str, Any]:
    """How often the paper's objective chooses the same settings for the same belief, all platforms together.

    Keys: ``both`` (PRF and pixel angle of a platform), ``prf``, ``angle``; ``late``, as ``both`` for the last half.
    """
    same: Array = np.isclose(runs.settings, runs.rival, rtol=1e-9, atol=0.0)
    both, half = np.asarray(same.all(axis=-1)), same.shape[1] // 2
    shares = {"both": both, "prf": same[..., PRF], "angle": same[..., ANGLE], "late": both[:, half:]}
    return {key: plain(share_estimate(of.mean(axis=(1, 2)), seed)) for key, of in shares.items()}


def quantiles(runs: Runs) -> Array:
    """Over runs, (quantile, k, platform, parameter)."""
    return np.quantile(runs.settings, QUANTILES, axis=0)


def adaptation(runs: Runs, loop: RfEo, marks: list[int], seed: int) -> dict[str, Any]:
    """How settings follow the targets.

    Keys:
        marks: steps.
        angle: for each platform its quantiles over runs (10, 50 and 90 %) at these steps, rad.
        factor: for each platform the greatest divided by the smallest pixel angle of a run, a geometric mean.
        factor_late: the same over the last half.
        finest: share of runs in which platform 2 has the smaller pixel angle over the last half (geometric mean).
        second_over_first: its pixel angle divided by that of platform 1, both geometric means over the last half.
        narrower: of the steps in the last half with different pixel angles, the share at which the platform with the
        finer pixels sees the targets closer to its look direction.
    """
    half, angle = runs.settings.shape[1] // 2, runs.settings[..., ANGLE]
    late = np.exp(np.log(angle[:, half:]).mean(axis=1))
    spread = quantiles(runs)[..., ANGLE]
    return {
        "marks": marks,
        "angle": [[spread[:, k - 1, j].tolist() for k in marks] for j in range(angle.shape[2])],
        "factor": _factors(angle, seed),
        "factor_late": _factors(angle[:, half:], seed),
        "finest": plain(share_estimate((late[:, 1] < late[:, 0]).astype(float), seed)),
        "second_over_first": ratio_estimates(late[:, 1], late[:, 0], seed),
        "narrower": plain(share_estimate(_narrower(runs, loop, half), seed)),
    }


def _factors(angle: Array, seed: int) -> list[dict[str, Any]]:
    """Greatest divided by smallest pixel angle of each run, by platform."""
    return [ratio_estimates(of.max(axis=1), of.min(axis=1), seed) for of in np.moveaxis(angle, 2, 0)]


def _narrower(runs: Runs, loop: RfEo, start: int) -> Array:
    """(run,) share of steps; runs whose pixel angles never differ are left out."""
    offset = runs.truth[:, start:, :, None] - loop.places[:, :2]  # (run, k, target, platform, 2)
    azimuth = np.arctan2(offset[..., 0], offset[..., 1]) - loop.places[:, 2]
    widest = np.abs(np.angle(np.exp(1j * azimuth))).max(axis=2)
    angle = runs.settings[:, start:, :, ANGLE]
    differ = angle[..., 0] != angle[..., 1]
    follows = differ & ((angle[..., 0] < angle[..., 1]) == (widest[..., 0] < widest[..., 1]))
    some = differ.any(axis=1)
    return np.asarray(follows[some].sum(axis=1) / differ[some].sum(axis=1))
