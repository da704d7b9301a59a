"""The page "How much is there to gain": ``python -m agents.headroom_page RESULTS PAGE SWEEPS``."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from agents import blocks
from wavegym.core.command_line import guarded
from wavegym.core.errors import InputError
from wavegym.core.files import write_whole
from wavegym.evaluation.comparison import BASELINE
from wavegym.evaluation.consistency import flag_of, flag_of_ratio
from wavegym.evaluation.planner_sweep import LIMITS, best_by_limit, limit_name
from wavegym.evaluation.statistics import Estimate
from wavegym.evaluation.table import (
    decimal,
    flagged,
    interval,
    number,
    order_sentence,
    signed,
    tabulated,
    three_tables,
    titled,
)
from wavegym.registration import SYSTEMS
from wavegym.schedulers.tuned_constants import PLANNER, SIMPLE

START, END = "<!-- made by `make headroom`: -->", "<!-- to here -->"
BELIEF = ("policy", "mean cost", "95 %", "vs best-simple %", "95 %", "µs/decision")
TRUTH = ("policy", "squared error m²", "95 %", "vs best-simple %", "95 %", "RMS error m", "lost")
STEPS = ("random", "best-fixed", "cycle", "myopic", "plan-once", "best-planner")  # of the overview
TITLES = {"random": "random", SIMPLE: "best-simple", BASELINE: "myopic", PLANNER: "best planner"}  # of its third table


Sweeps = Mapping[str, Mapping[str, Mapping[str, str]]]  # by environment: ``best_by_limit``


def block(results: list[dict[str, Any]], sweeps: Sweeps | None = None) -> str:
    """The text between the markers: the overview, the best policy by decision time, and each environment's ladder."""
    bought = [_what_time_buys(sweeps)] if sweeps else []
    return "\n\n".join([overview(results), *bought, *(chapter(result) for result in results)])


def _what_time_buys(sweeps: Sweeps) -> str:
    """The best policy of each sweep within each limit on decision time."""
    rows = []
    for name, best in sweeps.items():
        within = [best.get(limit_name(limit)) for limit in LIMITS]
        rows.append([name, *("" if row is None else _swept(row) for row in within)])
    head = ["environment", *(f"{limit:g} ms" for limit in LIMITS[:-1]), "unlimited"]
    title = "The best policy within a CPU time for each decision, in per cent against the best heuristic"
    return f"{title} (on tuning worlds, ± standard error):\n\n{tabulated(head, rows)}"


def _swept(row: Mapping[str, str]) -> str:
    """A policy and its cost. If no planner is within the limit, it is a heuristic, shown without standard error."""
    policy = "@".join(filter(None, (row["planner"], row["base"])))
    error = f" ± {float(row['standard_error_percent']):.1f}" if row["planner"] else ""
    return f"`{policy}` {signed(float(row['cost_vs_best_simple_percent']))}{error}"


def overview(results: list[dict[str, Any]]) -> str:
    """Cost by belief and error by truth of each policy against the best heuristic, and the consistency."""
    costs_and_errors = blocks.both(_overview(results, _by_belief), _overview(results, _by_truth))
    measured = [result for result in results if result["nees_dimension"]]
    if not measured:
        return costs_and_errors
    title = "Mean NEES and ratio of true to believed squared error, flagged if off"
    return f"{costs_and_errors}\n\n{title}:\n\n{_consistency(measured)}"


Estimated = tuple[float | None, list[float] | None]  # a value and its interval


def _overview(results: list[dict[str, Any]], against_simple: Callable[[dict[str, Any]], Estimated]) -> str:
    """One line for each environment."""
    head = ["environment", "best heuristic", *STEPS[:-1], "best planner", "95 %"]
    rows = []
    for result in results:
        policies, prepared = result["policies"], result["tuned_constants"]
        cells = [signed(against_simple(policies[name])[0]) if name in policies else "" for name in STEPS]
        ends = interval(against_simple(policies[PLANNER])[1], signed)
        rows.append([_short(result), prepared.get(SIMPLE, SIMPLE), *cells, ends])
    return tabulated(head, rows)


def _consistency(results: list[dict[str, Any]]) -> str:
    """One line for each environment."""
    head = ["environment", "expected NEES"]
    for title in TITLES.values():
        head += [f"{title}: NEES", "true over believed"]
    rows = []
    for result in results:
        cells = [_short(result), str(result["nees_dimension"])]
        for row in (result["policies"][name] for name in TITLES):
            nees = Estimate(row["nees"]["mean"], row["nees"]["ci"])
            ratio = Estimate(row["true_over_believed"]["ratio"], row["true_over_believed"]["ci"])
            cells += [flagged(nees.value, flag_of(nees, result["nees_dimension"]))]
            cells += [flagged(ratio.value, flag_of_ratio(ratio))]
        rows.append(cells)
    return tabulated(head, rows)


def _by_belief(row: dict[str, Any]) -> Estimated:
    return row["vs_simple_percent"], row["vs_simple_ci"]


def _by_truth(row: dict[str, Any]) -> Estimated:
    return row["truth"]["geometric_percent"], row["truth"]["geometric_ci"]


def chapter(result: dict[str, Any]) -> str:
    """One environment's ladder, highest cost by belief first: cost by belief, error by truth, consistency."""
    prepared = result["tuned_constants"]
    names = {SIMPLE: prepared.get(SIMPLE), PLANNER: prepared.get(PLANNER)}
    policies = {
        f"**{name}**: {names[name]}" if names.get(name) else name: row
        for name, row in sorted(result["policies"].items(), key=lambda item: -item[1]["mean"])
    }
    title = f"## {_short(result)}: {result['worlds']} worlds of {result['horizon']} steps"
    shown = three_tables(result, policies, (BELIEF, _belief_row), (TRUTH, _truth_row))
    parts = [title, *map(titled, shown), order_sentence(result["reversals"]), _recovered(result)]
    return "\n\n".join(filter(None, parts))


def _belief_row(row: dict[str, Any]) -> list[str]:
    return [
        number(row["mean"]),
        interval(row["ci"], number),
        *_estimated(_by_belief(row)),
        f"{row['us_per_decision']:.1f}",
    ]


def _truth_row(row: dict[str, Any]) -> list[str]:
    truth = row["truth"]
    return [
        number(truth["mean"]),
        interval(truth["ci"], number),
        *_estimated(_by_truth(row)),
        number(truth["root"]),
        decimal(row["lost"]),
    ]


def _estimated(against: Estimated) -> list[str]:
    return [signed(against[0]), interval(against[1], signed)]


def _recovered(result: dict[str, Any]) -> str:
    """The share of the planner's gain that a plan made once reaches, if there is such a plan."""
    policies = result["policies"]
    if "plan-once" not in policies or policies[PLANNER]["vs_simple_ci"][1] >= 0:
        return ""
    once, best = (math.log1p(policies[name]["vs_simple_percent"] / 100.0) for name in ("plan-once", PLANNER))
    share = once / best
    if share <= 0.0:
        return "A plan made once recovers nothing of the planner's gain."
    return f"A plan made once recovers {100.0 * share:.0f} % of the planner's gain."


def _short(result: dict[str, Any]) -> str:
    return str(result["env"]).rpartition("/")[2]


def renewed(page: str, results: list[dict[str, Any]], sweeps: Sweeps | None = None) -> str:
    """The page with a new block; InputError if it has none."""
    return blocks.renewed(page, START, END, block(results, sweeps))


def _read(file: Path) -> dict[str, Any]:
    """The figures in a file. Raises an InputError for a file of an earlier version, which has no figures by truth."""
    result: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    if "reversals" not in result:
        raise InputError(f"{file} has no figures by truth, expected it from `make headroom IDS={file.stem}`")
    return result


def main(arguments: list[str]) -> int:
    """The command; returns its exit status."""

    def renew() -> None:
        if len(arguments) != 3:
            raise InputError("expected three arguments: python -m agents.headroom_page RESULTS PAGE SWEEPS")
        folder, page, swept = (Path(argument) for argument in arguments)
        names = [env_id.rpartition("/")[2] for env_id in SYSTEMS]
        on_file = {name: swept / f"{name}.csv" for name in names if (swept / f"{name}.csv").exists()}
        sweeps = {name: best_by_limit(file.read_text(encoding="utf-8")) for name, file in on_file.items()}
        files = [folder / f"{name}.json" for name in names]
        results = [_read(file) for file in files if file.exists()]
        write_whole(page.parent, {page.name: renewed(page.read_text(encoding="utf-8"), results, sweeps).encode()})

    return guarded(renew)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
