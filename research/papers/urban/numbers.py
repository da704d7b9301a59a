"""The numbers of the urban figures, with intervals, as ``summary.json`` has them."""

from __future__ import annotations

from typing import Any

import numpy as np

from research.papers.estimates import mean_estimate, plain, ratio_estimates, rms_estimate, rms_ratio, share_estimate
from research.papers.urban.false_tracks import ORIGINS
from research.papers.urban.motion_models import models
from research.papers.urban.study import CASES, CLOSED, GHOSTS, OPEN, SETTINGS, STARTS, Case, Runs, Study, system
from wavegym.core.arrays import Array
from wavegym.evaluation.statistics import Estimate
from wavegym.evaluation.summary import versions


def summarise(study: Study) -> dict[str, Any]:
    """All numbers, as plain types; None if there is no estimate.

    Keys:
        command, seed, runs, scans, versions; ``seen``: share of the targets' scans at which the direct paths to both
        receivers are open; ``starts``: a list by ``vaguest`` of the closed loop's figures ``over_open`` and of the
        false tracks of both loops; and settings, "loose" and "strict": ``vaguest`` in m; ``models`` of the closed loop
        (``motion_models.models``); ``ghosts_over_none``: held targets and false tracks with ghost logic divided by
        those without, for the closed and the open loop; ``systems``: figures with and without ghost logic, by filter
        and policy.

        The figures are: ``confirmed``, tracks at a scan; ``rmse`` {mean, ci}, root of the mean squared position error
        in m over all runs, scans and targets held; ``held``, share of the targets' scans at which a confirmed track is
        within 20 m; ``lost``, share of the seen scans without such a track; ``losses``, how often in a run a held
        target is not held at the next scan; ``gospa``, m; ``false``, tracks at a scan with no target within 20 m;
        ``false_tracks`` {mean, ci, origins}, different false tracks in a run (``false_tracks``); ``long``, share of the
        longest pulse in the scans with a track; ``over_closed`` and ``over_open``: confirmed, held, rmse and gospa
        {ratio, ci} relative to the paper's closed and open loop with the same setting and ghost logic.

        Intervals are [low, high], 95 %: of a BCa bootstrap over runs, ratios in pairs on the same worlds; of a share
        that is 0 or 1 in each run, or the same in all, from the binomial distribution (Clopper and Pearson).
    """
    closed = study.of(next(iter(SETTINGS)), CLOSED)
    count, scans = closed.confirmed.shape
    scene = system(CASES[0]).scene
    return {
        "command": f"python -m research.papers urban --runs {count} --seed {study.seed}",
        "seed": study.seed,
        "runs": count,
        "scans": scans,
        "versions": versions(),
        "seen": float(scene.direct[1:].sum() / scene.present[1:].sum()),
        "settings": {setting: _setting(study, setting) for setting in SETTINGS},
        "starts": [_start(study, start) for start in STARTS],
    }


def figures_of(summary: dict[str, Any], setting: str, loop: tuple[str, str], ghosts: bool = True) -> dict[str, Any]:
    """The figures of one filter and policy, from a summary."""
    of, policy = loop
    found: dict[str, Any] = summary["settings"][setting]["systems"][GHOSTS[ghosts]][of][policy]
    return found


def phase_of(summary: dict[str, Any], setting: str, phase: str) -> dict[str, Any]:
    """The models of the first target in one phase, from a summary."""
    found: dict[str, Any] = next(of for of in summary["settings"][setting]["models"][0] if of["phase"] == phase)
    return found


def confirmed_curve(runs: Runs, seed: int) -> list[Estimate]:
    """Mean number of confirmed tracks at each scan."""
    return [mean_estimate(column, seed) for column in runs.confirmed.T]


def rmse_curve(runs: Runs, seed: int) -> list[Estimate]:
    """Root mean square position error of the targets held, m, at each scan; None where none is."""
    squares, counts = _squares(runs)
    return [rms_estimate(square, count, seed) for square, count in zip(squares.T, counts.T, strict=True)]


def _setting(study: Study, setting: str) -> dict[str, Any]:
    seed = study.seed
    systems: dict[str, Any] = {name: {} for name in GHOSTS.values()}
    for case in CASES:
        if case.setting == setting:
            systems[GHOSTS[case.ghosts]].setdefault(case.filter, {})[case.policy] = _figures(study, case)
    with_and_without = {
        name: [study.of(setting, loop, ghosts) for ghosts in (True, False)]
        for name, loop in (("closed", CLOSED), ("open", OPEN))
    }
    return {
        "vaguest": SETTINGS[setting],
        "models": models(study.of(setting, CLOSED).mu, system(Case(setting, True, *CLOSED)), seed),
        "ghosts_over_none": {
            name: {
                "held": ratio_estimates(_held(ours), _held(none), seed),
                "false_tracks": ratio_estimates(ours.origins.sum(axis=1), none.origins.sum(axis=1), seed),
            }
            for name, (ours, none) in with_and_without.items()
        },
        "systems": systems,
    }


def _start(study: Study, start: str) -> dict[str, Any]:
    """The closed loop against the open one, for one limit on new tracks."""
    closed, opened = (study.of(start, loop) for loop in (CLOSED, OPEN))
    return {
        "vaguest": STARTS[start],
        "over_open": _over(closed, opened, study.seed),
        "false_tracks": plain(mean_estimate(closed.origins.sum(axis=1), study.seed)),
        "false_tracks_open": plain(mean_estimate(opened.origins.sum(axis=1), study.seed)),
    }


def _figures(study: Study, case: Case) -> dict[str, Any]:
    seed, runs, loop = study.seed, study.runs[case], system(case)
    there, seen = loop.scene.present[1:].sum(), loop.scene.direct[1:].sum()
    gone = runs.held[:, :-1] & ~runs.held[:, 1:]  # a present target stays
    is_long = runs.action // 2 == np.argmax(loop.durations)
    tracked = runs.tracked.sum(axis=1)
    return {
        "confirmed": plain(mean_estimate(runs.confirmed.mean(axis=1), seed)),
        "rmse": plain(rms_estimate(*_totals(runs), seed)),
        "held": plain(share_estimate(_held(runs) / there, seed)),
        "lost": plain(share_estimate(runs.lost.sum(axis=(1, 2)) / seen, seed)),
        "losses": plain(mean_estimate(gone.sum(axis=(1, 2)), seed)),
        "gospa": plain(mean_estimate(runs.gospa.mean(axis=1), seed)),
        "false": plain(mean_estimate(runs.false.mean(axis=1), seed)),
        "false_tracks": {
            **plain(mean_estimate(runs.origins.sum(axis=1), seed)),
            "origins": {name: plain(mean_estimate(of, seed)) for name, of in zip(ORIGINS, runs.origins.T, strict=True)},
        },
        "long": plain(share_estimate((is_long & runs.tracked).sum(axis=1)[tracked > 0] / tracked[tracked > 0], seed)),
        "over_closed": _over(runs, study.of(case.setting, CLOSED, case.ghosts), seed),
        "over_open": _over(runs, study.of(case.setting, OPEN, case.ghosts), seed),
    }


def _over(runs: Runs, reference: Runs, seed: int) -> dict[str, Any]:
    """Ratios to the reference on the same worlds."""
    return {
        "confirmed": ratio_estimates(runs.confirmed.mean(axis=1), reference.confirmed.mean(axis=1), seed),
        "held": ratio_estimates(_held(runs), _held(reference), seed),
        "rmse": rms_ratio(_totals(runs), _totals(reference), seed),
        "gospa": ratio_estimates(runs.gospa.mean(axis=1), reference.gospa.mean(axis=1), seed),
    }


def _held(runs: Runs) -> Array:
    """Number of scans at which targets are held, (run,)."""
    count: Array = runs.held.sum(axis=(1, 2))
    return count


def _totals(runs: Runs) -> tuple[Array, Array]:
    """Of ``_squares``, (run,)."""
    squares, counts = _squares(runs)
    return squares.sum(axis=1), counts.sum(axis=1)


def _squares(runs: Runs) -> tuple[Array, Array]:
    """Squared errors of the targets held, summed, and their number, (run, k)."""
    return np.square(np.where(runs.held, runs.error, 0.0)).sum(axis=2), runs.held.sum(axis=2)
