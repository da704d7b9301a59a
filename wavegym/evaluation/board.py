"""The board: tables and picture of several submissions that played the same worlds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.worlds import word
from wavegym.evaluation import statistics
from wavegym.evaluation.picture import as_png
from wavegym.evaluation.submission import suite
from wavegym.evaluation.suite_score import over_suite, profile, suite_score
from wavegym.evaluation.table import estimated, interval, shared, signed, tabulated

Record = Mapping[str, Any]  # of ``submission.play_submission``
FARTHEST = 50.0  # per cent, of the picture


def table(record: Record) -> str:
    """A line for each environment of one submission: cost by belief and squared error by truth against best-simple.

    *Share of the gap* is the submission's gain over best-simple, in logarithms, over that of the lower bound.
    """
    rows = []
    for env_id, found in record["environments"].items():
        cells = [env_id.rpartition("/")[2]]
        for figure in ("cost", "error"):
            estimate = statistics.difference(*_pair(found, figure), _bootstrap(record)).geometric
            cells += estimated(estimate)
        cells += _share_of_gap(found, record)
        spent = found["cpu_seconds"]
        rows.append([*cells, f"{found['microseconds']:g}", f"{found['steps']}", "" if spent is None else f"{spent:g}"])
    head = ["environment", "cost %", "95 %", "squared error by truth %", "95 %"]
    head += ["bound %", "share of the gap", "95 %", "us", "steps", "CPU seconds"]
    return tabulated(head, rows)


def scores(records: Sequence[Record]) -> str:
    """A line for each submission over the whole suite, the cheapest first."""
    known, lines = suite(), list[tuple[float, list[str]]]()
    for record in records:
        found = suite_score(_logs(record), known, _bootstrap(record))
        cells = [record["name"], f"{len(record['environments'])} of {len(known)}"]
        for estimate in (found.mean, found.interquartile):
            cells += estimated(estimate)
        ends = interval(found.improvement.ci, "{:.2f}".format)
        cells += [f"{found.improvement.value:.2f}", ends, record["code"]]
        lines.append((found.mean.value or 0.0, cells))
    head = ["submission", "plays", "geometric mean %", "95 %", "interquartile mean %", "95 %"]
    ordered = [cells for _, cells in sorted(lines, key=lambda line: line[0])]
    return tabulated([*head, "probability of improvement", "95 %", "code"], ordered)


def picture(records: Sequence[Record]) -> bytes:
    """Performance profiles as PNG: the share of worlds that cost at most so much more than under best-simple."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes, known = figure.subplots(), suite()
    percents = np.linspace(-FARTHEST, FARTHEST, 401)
    for record in records:
        axes.plot(percents, profile(over_suite(_logs(record), known), percents), label=record["name"])
    axes.axvline(0.0, color="0.8", linewidth=0.8, zorder=0)
    axes.set(xlabel="cost above that of the best simple heuristic [%]", ylabel="share of environments and worlds")
    axes.set(xlim=(-FARTHEST, FARTHEST), ylim=(0.0, 1.0))
    axes.legend(fontsize="small")
    return as_png(figure)


def _logs(record: Record) -> dict[str, Array]:
    """ln of the ratios of the costs, (world,), by environment."""
    pairs = {env_id: _pair(found, "cost") for env_id, found in record["environments"].items()}
    return {env_id: np.log(own / simple)[0] for env_id, (own, simple) in pairs.items()}


def _share_of_gap(found: Mapping[str, Any], record: Record) -> list[str]:
    """The lower bound against best-simple and the share of the gap to it; empty where no bound is known."""
    if "bound" not in found:
        return ["", "", ""]
    cost, simple = _pair(found, "cost")
    bound = np.array([found["bound"]], np.float64)
    share = statistics.ratio(np.log(cost / simple), np.log(bound / simple), _bootstrap(record))
    return [signed(statistics.difference(bound, simple, _bootstrap(record)).geometric.value), *shared(share)]


def _pair(found: Mapping[str, Any], figure: str) -> tuple[Array, Array]:
    """A figure of the submission and of the best simple heuristic, (1, world) each."""
    own, simple = (np.array([found[name]], np.float64) for name in (figure, f"simple_{figure}"))
    return own, simple


def _bootstrap(record: Record) -> np.random.Generator:
    return np.random.default_rng([record["root"], word("bootstrap")])
