"""The agile chirps' figures as files: CSV, PNG, summary.json, and a table for the terminal."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from wavegym.envs.describe import table
from wavegym.evaluation.files import write_whole
from wavegym.reproduce.agile_clutter import FULL, LAWS, Case, Study
from wavegym.reproduce.agile_clutter_numbers import curve, shares, summarise, typical
from wavegym.reproduce.agile_clutter_pictures import draw_errors, draw_laws

FIGURE2 = ("policy", "clutter", "tracker", "k", "mse", "low", "high", "kept")
FIGURE3 = ("tracker", "k", "sensor", "law", "share", "typical")
SENSORS = "ABCDEFGHIJKLMNOP"  # as the paper names them


def write(study: Study, folder: Path) -> str:
    """Write the five files, all or none, and return the table.

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
    return markdown(summary)


def markdown(summary: dict[str, Any]) -> str:
    """A row for each tracker, clutter and policy; ratios are to the fully agile scheduler."""
    head = (
        "tracker", "", "policy", "kept %", "95 %", "MSE, kept runs", "95 %", "MSE, all runs", "median, all runs",
        "ratio, kept by both", "95 %", "ratio, all runs", "95 %",
    )  # fmt: skip
    rows = [
        (tracker, clutter, _name(name, setting), *_cells(policy))
        for tracker, settings in summary["trackers"].items()
        for clutter, setting in settings.items()
        for name, policy in setting["policies"].items()
    ]
    return table(head, rows)


def _name(policy: str, setting: dict[str, Any]) -> str:
    """The policy, and which waveforms the best fixed one has."""
    return policy if policy != "best fixed" else f"best fixed ({', '.join(setting['best_fixed']['waveforms'])})"


def _cells(policy: dict[str, Any]) -> list[str]:
    kept, own, everything = policy["kept"], policy["mse_kept"], policy["mse_all"]
    cells = [_percent(kept["mean"]), _range(kept["ci"], _percent)]
    cells += [
        _metres(own["mean"]),
        _range(own["ci"], _metres),
        _metres(everything["mean"]),
        _metres(everything["median"]),
    ]
    for ratio in (policy["ratio_kept"], policy["ratio_all"]):
        cells += [_times(ratio["ratio"]), _range(ratio["ci"], _times)]
    return cells


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.1f}"


def _metres(squared: float | None) -> str:
    return "" if squared is None else f"{squared:.0f}"


def _times(ratio: float | None) -> str:
    return "" if ratio is None else f"{ratio:.2f}" if ratio < 100 else f"{ratio:.0f}"


def _range(ci: list[float] | None, shown: Any) -> str:
    return "" if ci is None else f"{shown(ci[0])} to {shown(ci[1])}"


def _errors(study: Study, curves: dict[Case, list[Any]]) -> Iterable[Sequence[Any]]:
    """Rows of figure2.csv; a field is empty where there is no estimate."""
    for case, runs in study.runs.items():
        for k, (value, ci) in enumerate(curves[case], 1):
            yield case.policy, case.clutter, case.tracker, k, value, *(ci or ("", "")), int(runs.kept.sum())


def _choices(study: Study) -> Iterable[Sequence[Any]]:
    """Rows of figure3.csv: in clutter, the fully agile scheduler; ``typical`` is 1 for what the typical run chose."""
    for tracker in dict.fromkeys(case.tracker for case in study.runs):
        runs = study.runs[Case(tracker, "clutter", FULL)]
        share, run = shares(runs), typical(runs)
        for k, sensor, law in (
            (k, i, j) for k in range(len(run)) for i in range(run.shape[1]) for j in range(len(LAWS))
        ):
            yield tracker, k + 1, SENSORS[sensor], LAWS[law], share[k, sensor, law], int(run[k, sensor] == law)


def _csv(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue().encode()
