"""The RF/EO platforms' figures as files: CSV, PNG and summary.json."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from research.papers.contents import csv_bytes, json_bytes
from research.papers.rf_eo.adaptation import quantiles
from research.papers.rf_eo.numbers import curve, shown, summarise
from research.papers.rf_eo.pictures import CURVES, TRACKS, Curves, draw_errors, draw_settings, draw_tracks, hardest
from research.papers.rf_eo.study import ADAPTIVE, INFORMATION, SCENES, Study
from wavegym.core.files import write_whole

FIGURE2 = ("scene", "world", "target", "k", "policy", "true_x", "true_y", "x", "y")
FIGURE3 = ("scene", "policy", "target", "k", "rms", "low", "high", "nees")
PARAMETERS = ("prf", "bandwidth", "pixel_angle")
FIGURE4 = (
    "scene", "policy", "platform", "k", *(f"{name}{of}" for name in PARAMETERS for of in ("", "_10", "_50", "_90")),
)  # fmt: skip
FILES = ("figure2.csv", "figure3.csv", "figure4.csv", "figure2.png", "figure3.png", "figure4.png", "summary.json")


def write(study: Study, folder: Path) -> dict[str, Any]:
    """Write ``FILES``, all or none, and return the summary.

    Raises:
        OSError: the folder cannot be written or the disk is full; earlier files are then as they were.
    """
    curves = {
        (scene, policy, target): curve(study, scene, policy, target, shown(study.horizon(scene)))
        for scene in SCENES
        for policy in CURVES[scene]
        for target in range(study.of(scene, policy).error.shape[2])
    }
    summary = summarise(study)
    contents = (
        csv_bytes(FIGURE2, _tracks(study)),
        csv_bytes(FIGURE3, _errors(study, curves)),
        csv_bytes(FIGURE4, _settings(study)),
        draw_tracks(study),
        draw_errors(study, curves),
        draw_settings(study),
        json_bytes(summary),
    )
    write_whole(folder, dict(zip(FILES, contents, strict=True)))
    return summary


def _tracks(study: Study) -> Iterable[Sequence[Any]]:
    """Rows of figure2.csv, in m: the world with the largest error of the fixed settings."""
    for scene in SCENES:
        for policy in TRACKS[scene]:
            runs, world = study.of(scene, policy), hardest(study, scene)
            for target in range(runs.error.shape[2]):
                for k in shown(study.horizon(scene)):
                    places = (*runs.truth[world, k - 1, target], *runs.estimate[world, k - 1, target])
                    yield scene, world + 1, target + 1, k, policy, *map(_short, places)


def _errors(study: Study, curves: Curves) -> Iterable[Sequence[Any]]:
    """Rows of figure3.csv, in m; ``nees`` is the mean over runs. A field is empty where there is no estimate."""
    for (scene, policy, target), estimates in curves.items():
        nees = study.of(scene, policy).nees[:, :, target].mean(axis=0)
        for k, (value, ci) in zip(shown(study.horizon(scene)), estimates, strict=True):
            yield scene, policy, target + 1, k, _short(value), *map(_short, ci or ("", "")), _short(nees[k - 1])


def _settings(study: Study) -> Iterable[Sequence[Any]]:
    """Rows of figure4.csv, in Hz and rad: of the first world, and quantiles over runs in percent."""
    for scene in SCENES:
        for policy in (ADAPTIVE, INFORMATION):
            runs = study.of(scene, policy)
            spread = np.concatenate([runs.settings[:1], quantiles(runs)])  # (what, k, platform, parameter)
            for platform in range(spread.shape[2]):
                for k in shown(study.horizon(scene)):
                    yield scene, policy, platform + 1, k, *map(_short, spread[:, k - 1, platform].T.ravel())


def _short(value: Any) -> str:
    """Six figures."""
    return "" if value is None or value == "" else f"{value:.6g}"
