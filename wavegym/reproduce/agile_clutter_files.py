"""The agile chirps' figures as files: CSV, PNG and summary.json."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from wavegym.evaluation.files import write_whole
from wavegym.reproduce.agile_clutter import FREE, FULL, Case, Study, names
from wavegym.reproduce.agile_clutter_numbers import curve, shares, summarise, typical
from wavegym.reproduce.agile_clutter_pictures import SENSORS, draw_errors, draw_laws

FIGURE2 = ("policy", "clutter", "tracker", "k", "mse", "low", "high", "kept")
FIGURE3 = ("tracker", "policy", "k", "sensor", "law", "share", "typical")


def write(study: Study, folder: Path) -> dict[str, Any]:
    """Write the five files, all or none, and return what ``summary.json`` holds.

    Raises:
        OSError: the folder cannot be written or the disk is full; earlier files are then as they were.
    """
    curves = {case: curve(study, runs) for case, runs in study.runs.items()}
    summary = summarise(study)
    contents = {
        "figure2.csv": _csv(FIGURE2, _errors(study, curves)),
        "figure3.csv": _csv(FIGURE3, _choices(study)),
        "figure2.png": draw_errors(study, curves),
        "figure3.png": draw_laws(study),
        "summary.json": (json.dumps(summary, indent=2, allow_nan=False) + "\n").encode(),
    }
    write_whole(folder, contents)
    return summary


def _errors(study: Study, curves: dict[Case, list[Any]]) -> Iterable[Sequence[Any]]:
    """Rows of figure2.csv; a field is empty where there is no estimate."""
    for case, runs in study.runs.items():
        for k, (value, ci) in enumerate(curves[case], 1):
            yield case.policy, case.clutter, case.tracker, k, value, *(ci or ("", "")), int(runs.kept.sum())


def _choices(study: Study) -> Iterable[Sequence[Any]]:
    """Rows of figure3.csv, in clutter; ``typical`` is 1 for what the typical run chose."""
    for tracker in dict.fromkeys(case.tracker for case in study.runs):
        for policy in (FULL, FREE):
            runs, laws = study.runs[Case(tracker, "clutter", policy)], names(policy)
            share, run = shares(runs, len(laws)), typical(runs)
            for k in range(len(run)):
                for i in range(run.shape[1]):
                    for j, law in enumerate(laws):
                        yield tracker, policy, k + 1, SENSORS[i], law, share[k, i, j], int(run[k, i] == j)


def _csv(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue().encode()
