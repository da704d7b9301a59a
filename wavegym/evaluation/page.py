"""A comparison as one self-contained HTML page, drawn in the browser from the data in the page."""

from __future__ import annotations

import html
import json
import re
from importlib import resources
from typing import Any

import numpy as np

from wavegym.core.action_sets import waveform_labels
from wavegym.core.arrays import Array
from wavegym.evaluation.comparison import BASELINE, Comparison
from wavegym.evaluation.picture import percent_off
from wavegym.evaluation.play import Played, merged
from wavegym.evaluation.table import order_sentence, tables

TEMPLATE = "page.html"
DATA, TITLE = "__DATA__", "__TITLE__"
DIGITS = 4  # significant, of every number on the page
QUARTILES = (25.0, 50.0, 75.0)
MOST = 12  # options with a colour of their own; the others share one


def page(comparison: Comparison, summary: dict[str, Any]) -> bytes:
    """The page as HTML: cost over time, choices over time, paired differences, and one episode to step through.

    Args:
        comparison: the result of ``compare``.
        summary: the result of ``summarise``.
    """
    parameters = "".join(f", {key}={value}" for key, value in summary["parameters"].items())
    title = f"{comparison.task.env_id}{parameters}"
    # Inside a script element nothing may look like markup.
    data = json.dumps(_data(comparison, summary, title), allow_nan=False).replace("<", "\\u003c")
    template = (resources.files("wavegym.evaluation") / TEMPLATE).read_text("utf-8")
    # In one pass: a title that holds the mark of the data stays a title.
    filled = {TITLE: html.escape(title), DATA: data}
    return re.sub("|".join(filled), lambda mark: filled[mark[0]], template).encode()


def _data(comparison: Comparison, summary: dict[str, Any], title: str) -> dict[str, Any]:
    """The data of the page, as plain types."""
    played = {name: merged(members) for name, members in comparison.played.items()}
    options, names = _options(comparison, played)
    cost, shown = comparison.cost(BASELINE).mean(axis=0), tables(summary)
    world = int(np.argsort(cost, kind="stable")[len(cost) // 2])  # with the baseline's median cost
    return {
        "title": title,
        "tables": [table._asdict() for table in shown],
        "orders": order_sentence(summary["reversals"]),
        "worlds": len(comparison.seeds),
        "dt": comparison.task.system.dt,
        "baseline": BASELINE,
        "options": names,
        "replay": {"world": world, "seed": str(comparison.seeds[world])},
        "policies": [
            {
                "name": name,
                "percent": _short(percent_off(comparison.cost(name).mean(axis=0), cost)),  # mean over training runs
                **_policy(played[name], comparison.played[name][0], world, options),
            }
            for name in shown[0].columns[0][1:]  # in the tables' order
        ],
    }


def _options(comparison: Comparison, played: dict[str, Played]) -> tuple[Array, list[str]]:
    """The legend's row of each waveform, (waveform,), and the legend: the commonest first, the others as one row."""
    labels = waveform_labels(comparison.task.system.actions)
    used = np.sum([record.chosen.sum(axis=(0, 1)) for record in played.values()], axis=0)
    order = [int(i) for i in np.argsort(-used, kind="stable") if used[i]]
    shown = order if len(order) <= MOST else order[: MOST - 1]
    row = np.full(len(labels), len(shown))
    row[shown] = np.arange(len(shown))
    return row, [labels[i] for i in shown] + (["other"] if len(order) > len(shown) else [])


def _policy(record: Played, first: Played, world: int, options: Array) -> dict[str, Any]:
    """A policy over time, and one episode of its first member to step through.

    ``low`` to ``high`` are quartiles of the cost after each step, over the worlds still running. ``episode`` has the
    cost after each step and the legend's row of each transmission, (sensor, step).
    """
    low, median, high = (_short(quartile) for quartile in np.nanpercentile(record.cost, QUARTILES, axis=0))
    steps = first.steps[world]
    rows = options[first.choice[world, :steps]].T.tolist() if len(options) else []
    episode = {"cost": _short(first.cost[world, :steps]), "rows": rows}
    return {"low": low, "median": median, "high": high, "shares": _shares(record, options), "episode": episode}


def _shares(record: Played, options: Array) -> list[list[list[float | None]]]:
    """The share of each row of the legend at each step and sensor, (sensor, step, row)."""
    if not len(options):
        return []
    rows = np.where(record.choice >= 0, options[record.choice], -1)
    count = options.max() + 1
    shares = np.stack([(rows == k).sum(axis=0) for k in range(count)], axis=2) / (rows >= 0).sum(axis=0)[..., None]
    return [[_short(step) for step in sensor] for sensor in np.swapaxes(shares, 0, 1)]


def _short(values: Array) -> list[float | None]:
    """Numbers with DIGITS significant digits; None for a value that is not finite."""
    return [float(f"{v:.{DIGITS}g}") if np.isfinite(v) else None for v in np.asarray(values).tolist()]
