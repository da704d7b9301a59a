"""The agile chirps' figures as files: CSV, PNG and summary.json."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from research.papers.agile_clutter.numbers import curve, shares, summarise, typical
from research.papers.agile_clutter.pictures import SENSORS, draw_errors, draw_laws
from research.papers.agile_clutter.study import FREE, FULL, Case, Study, names
from research.papers.contents import csv_bytes, json_bytes
from wavegym.core.files import write_whole

FIGURE2 = ("policy", "clutter", "tracker", "k", "mse", "low", "high", "kept")
FILES = ("figure2.csv", "figure3.csv", "figure2.png", "figure3.png", "summary.json")
FIGURE3 = ("tracker", "policy", "k", "sensor", "law", "share", "typical")


def write(study: Study, folder: Path) -> dict[str, Any]:
    """Write ``FILES``, all or none, and return the summary.

    Raises:
        OSError: the folder cannot be written or the disk is full; earlier files are then as they were.
    """
    curves = {case: curve(study, runs) for case, runs in study.runs.items()}
    summary = summarise(study)
    contents = (
        csv_bytes(FIGURE2, _errors(study, curves)),
        csv_bytes(FIGURE3, _choices(study)),
        draw_errors(study, curves),
        draw_laws(study),
        json_bytes(summary),
    )
    write_whole(folder, dict(zip(FILES, contents, strict=True)))
    return summary


def _errors(study: Study, curves: dict[Case, list[Any]]) -> Iterable[Sequence[Any]]:
    """Rows of figure2.csv; a field is empty where there is no estimate."""
    for case, runs in study.runs.items():
        for k, (value, ci) in enumerate(curves[case], 1):
            yield case.policy, case.clutter, case.tracker, k, value, *(ci or ("", "")), int(runs.kept.sum())


def _choices(study: Study) -> Iterable[Sequence[Any]]:
    """Rows of figure3.csv, in clutter; ``typical`` is 1 for the choices of the typical run."""
    for tracker in dict.fromkeys(case.tracker for case in study.runs):
        for policy in (FULL, FREE):
            runs, laws = study.runs[Case(tracker, "clutter", policy)], names(policy)
            share, run = shares(runs, len(laws)), typical(runs)
            for k in range(len(run)):
                for i in range(run.shape[1]):
                    for j, law in enumerate(laws):
                        yield tracker, policy, k + 1, SENSORS[i], law, share[k, i, j], int(run[k, i] == j)
