"""A comparison as files: summary.json, episodes.csv, table.md, comparison.png and report.html."""

from __future__ import annotations

import csv
import json
import lzma
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wavegym.core.action_sets import waveform_labels
from wavegym.core.errors import InputError
from wavegym.core.files import csv_text, write_whole
from wavegym.evaluation.comparison import Comparison
from wavegym.evaluation.page import page
from wavegym.evaluation.picture import draw
from wavegym.evaluation.play import BY_EPISODE, EpisodeResults, Played, results_of
from wavegym.evaluation.summary import summarise
from wavegym.evaluation.table import markdown

COLUMNS = ("policy", "member", "world", "seed", "steps", *BY_EPISODE)
TABLE = ".csv.xz"  # suffix of the suite's own results
FAVOURITE = ("favourite", "favourite_share")


def write_report(comparison: Comparison, folder: Path | str) -> str:
    """Write the five files, all or none, and return the table.

    Args:
        comparison: the result of ``compare``.
        folder: made if it does not exist.

    Raises:
        OSError: the folder cannot be written or the disk is full; earlier files are then as they were.
    """
    summary = summarise(comparison)
    table = markdown(summary)
    write_whole(
        Path(folder),
        {
            "episodes.csv": episodes(comparison).encode(),
            "comparison.png": draw(comparison, summary),
            "report.html": page(comparison, summary),
            "table.md": f"{table}\n".encode(),
            "summary.json": (json.dumps(summary, indent=2, allow_nan=False) + "\n").encode(),
        },
    )
    return table


def episodes(comparison: Comparison) -> str:
    """``episodes.csv``: a row per policy, member and world, with every digit; the same for any number of jobs.

    ``env.reset(seed=[seed])`` replays the world. ``cost`` to ``outside`` are the ``EpisodeResults``. ``favourite`` is
    the waveform transmitted most often, and ``favourite_share`` its share, 0 to 1. Several targets add ``rmse_1``,
    ``rmse_2``, ... and several sensors have ``favourite_1``, ``favourite_share_1``, ... A field without a value is
    empty.
    """
    labels = waveform_labels(comparison.task.system.actions)
    first = next(iter(comparison.played.values()))[0]
    targets, sensors = first.target_rmse.shape[1], first.chosen.shape[1]
    each = [f"rmse_{i + 1}" for i in range(targets)] if targets > 1 else []
    favourites = [f"{name}_{i + 1}" for i in range(sensors) for name in FAVOURITE] if sensors > 1 else FAVOURITE
    rows = (
        [name, member, world, comparison.seeds[world], *row]
        for name, members in comparison.played.items()
        for member, played in enumerate(members)
        for world, row in enumerate(_rows(played, labels))
    )
    return csv_text([*COLUMNS, *each, *favourites], rows)


def _rows(played: Played, labels: tuple[str, ...]) -> list[list[Any]]:
    """One member's fields of each world, from ``steps`` on."""
    (numbers,) = np.stack(results_of([played]), axis=2)
    if played.target_rmse.shape[1] > 1:
        numbers = np.concatenate([numbers, played.target_rmse], axis=1)
    rows = []
    for steps, values, chosen in zip(played.steps, numbers, played.chosen, strict=True):
        favourites = [cell for sensor in chosen for cell in (labels[sensor.argmax()], float(sensor.max() / steps))]
        rows.append([steps, *["" if np.isnan(v) else float(v) for v in values], *(favourites or ["", ""])])
    return rows


def compressed(by_policy: Mapping[str, EpisodeResults]) -> bytes:
    """A file ``TABLE`` with every digit of the results, by policy; the same results give the same bytes."""
    rows = (
        [name, member, *("" if np.isnan(value) else value for value in values)]
        for name, results in by_policy.items()
        for member, table in enumerate(np.stack(results, axis=2).tolist())
        for values in table
    )
    return lzma.compress(csv_text(("policy", "member", *BY_EPISODE), rows).encode(), preset=9)


def read_results(file: Path) -> dict[str, EpisodeResults]:
    """The results by policy in an episodes.csv or a file ``TABLE``. A column that the file lacks is NaN.

    Raises:
        InputError: the file is missing.
    """
    if not file.exists():
        raise InputError(f"{file} is missing, expected it from `make headroom` or `python -m agents.leaderboard`")
    rows: dict[str, dict[int, list[list[float]]]] = {}
    opened = lzma.open if file.suffix == ".xz" else open
    with opened(file, "rt", newline="", encoding="utf-8") as lines:
        for row in csv.DictReader(lines):
            members = rows.setdefault(row["policy"], {})
            members.setdefault(int(row["member"]), []).append([float(row.get(key) or "nan") for key in BY_EPISODE])
    values = {name: np.array([members[m] for m in sorted(members)]) for name, members in rows.items()}
    return {name: EpisodeResults(*np.moveaxis(table, 2, 0)) for name, table in values.items()}
