"""The street's figures as files: CSV, PNG and summary.json."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from research.papers.contents import csv_bytes, json_bytes
from research.papers.urban.motion_models import probability
from research.papers.urban.numbers import confirmed_curve, rmse_curve, summarise
from research.papers.urban.pictures import (
    NAMES,
    Curves,
    ModelCurves,
    draw_confirmed,
    draw_errors,
    draw_models,
    draw_scene,
    no_target,
)
from research.papers.urban.study import CLOSED, LOOSE, OPEN, SETTINGS, Case, Study, system
from wavegym.core.files import write_whole
from wavegym.systems.urban.tracker import MODELS

FIGURE3 = ("of", "number", "k", "x", "y", "xdot", "ydot", "no_target")
FIGURE4 = ("setting", "filter", "policy", "k", "confirmed", "low", "high")
FIGURE5 = ("setting", "filter", "policy", "k", "rms", "low", "high", "held")
FIGURE6 = ("setting", "target", "model", "k", "probability", "low", "high", "runs")
FILES = (*(f"figure{n}.csv" for n in (3, 4, 5, 6)), *(f"figure{n}.png" for n in (3, 4, 5, 6)), "summary.json")


def write(study: Study, folder: Path) -> dict[str, Any]:
    """Write ``FILES``, all or none, and return the summary.

    Raises:
        OSError: the folder cannot be written or the disk is full; earlier files are then as they were.
    """
    pairs = [(setting, loop) for setting in SETTINGS for loop in NAMES]
    confirmed = {pair: confirmed_curve(study.of(*pair), study.seed) for pair in pairs}
    errors = {pair: rmse_curve(study.of(*pair), study.seed) for pair in pairs}
    models: ModelCurves = {
        (setting, target, name): probability(study.of(setting, CLOSED).mu, target, m, study.seed)
        for setting in SETTINGS
        for target in range(study.of(setting, CLOSED).mu.shape[2])
        for m, name in enumerate(MODELS)
    }
    summary = summarise(study)
    contents = (
        csv_bytes(FIGURE3, _tracks(study)),
        csv_bytes(FIGURE4, _confirmed(confirmed)),
        csv_bytes(FIGURE5, _errors(study, errors)),
        csv_bytes(FIGURE6, _models(study, models)),
        draw_scene(study),
        draw_confirmed(study, confirmed),
        draw_errors(study, errors),
        draw_models(study, models),
        json_bytes(summary),
    )
    write_whole(folder, dict(zip(FILES, contents, strict=True)))
    return summary


def _tracks(study: Study) -> Iterable[Sequence[Any]]:
    """Rows of figure3.csv, in m and m/s: the targets, and the confirmed tracks of the first run by their slots."""
    loop = system(Case(LOOSE, True, *CLOSED))
    for k, target in np.argwhere(loop.scene.present[1:]):
        yield "target", target + 1, k + 1, *map(_short, loop.scene.truth[k + 1, target, :4]), ""
    for name, of in (("closed loop", CLOSED), ("open loop", OPEN)):
        place = study.of(LOOSE, of).place[0]
        far = no_target(loop, place)
        for k, slot in np.argwhere(np.isfinite(place[..., 0])):
            yield name, slot + 1, k + 1, *map(_short, place[k, slot]), int(far[k, slot])


def _confirmed(curves: Curves) -> Iterable[Sequence[Any]]:
    """Rows of figure4.csv."""
    for (setting, loop), estimates in curves.items():
        for k, (value, ci) in enumerate(estimates, 1):
            yield setting, *loop, k, _short(value), *map(_short, ci or ("", ""))


def _errors(study: Study, curves: Curves) -> Iterable[Sequence[Any]]:
    """Rows of figure5.csv, in m; ``held`` is the mean number of targets held. A field is empty without an estimate."""
    for (setting, loop), estimates in curves.items():
        held = study.of(setting, loop).held.sum(axis=2).mean(axis=0)
        for k, (value, ci) in enumerate(estimates, 1):
            yield setting, *loop, k, _short(value), *map(_short, ci or ("", "")), _short(held[k - 1])


def _models(study: Study, curves: ModelCurves) -> Iterable[Sequence[Any]]:
    """Rows of figure6.csv; ``runs`` is how many hold the target."""
    for (setting, target, model), estimates in curves.items():
        runs = np.isfinite(study.of(setting, CLOSED).mu[:, :, target, 0]).sum(axis=0)
        for k, (value, ci) in enumerate(estimates, 1):
            yield setting, target + 1, model, k, _short(value), *map(_short, ci or ("", "")), runs[k - 1]


def _short(value: Any) -> str:
    """Six figures."""
    return "" if value is None or value == "" else f"{value:.6g}"
