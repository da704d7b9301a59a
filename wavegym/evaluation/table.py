"""Results as Markdown tables, with their columns aligned for a terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from wavegym.evaluation.consistency import flag_of, flag_of_ratio
from wavegym.evaluation.statistics import Estimate

BELIEF = (
    "policy",
    "mean cost",
    "95 %",
    "mean vs myopic %",
    "95 %",
    "geometric vs myopic %",
    "95 %",
    "score",
    "µs/decision",
)
TRUTH = (
    "policy",
    "squared error m²",
    "95 %",
    "mean vs myopic %",
    "95 %",
    "geometric vs myopic %",
    "95 %",
    "RMS error m",
    "lost",
    "collisions",
    "spectrum %",
)
CONSISTENCY = ("policy", "NEES", "95 %", "steps outside %", "true over believed", "95 %")


Layout = tuple[tuple[str, ...], Callable[[dict[str, Any]], list[str]]]  # headings, and what makes a policy's cells


class Table(NamedTuple):
    """A table with a line above it."""

    title: str
    columns: list[list[str]]  # each under its heading; the first names the rows


def markdown(summary: dict[str, Any]) -> str:
    """What was played, and the tables."""
    parameters = "".join(f", {key}={value}" for key, value in summary["parameters"].items())
    worlds = f"{summary['worlds']} world{'s' * (summary['worlds'] > 1)}"
    title = f"{summary['env']}{parameters}: {worlds}, seed {summary['seed']}"
    return "\n\n".join([title, *map(titled, tables(summary)), order_sentence(summary["reversals"])])


def tables(summary: dict[str, Any]) -> list[Table]:
    """``three_tables`` of a summary, the cheapest policy first."""
    means = {name: policy["cost"]["mean"] for name, policy in summary["policies"].items()}
    cheapest_first = sorted(means, key=lambda name: math.inf if means[name] is None else means[name])
    policies = {name: summary["policies"][name] for name in cheapest_first}
    return three_tables(summary, policies, (BELIEF, _belief_row), (TRUTH, _truth_row))


def three_tables(figures: Mapping[str, Any], policies: Mapping[str, Any], belief: Layout, truth: Layout) -> list[Table]:
    """Cost by belief, error by truth and consistency of the tracker: one row for each policy, in their order.

    A column without any entry is left out, and so is a table without figures.

    Args:
        figures: what all policies share: ``in_gospa`` and ``nees_dimension``.
        policies: the figures of each.
        belief, truth: of the first two tables.
    """
    error, dimension = "the GOSPA distance" if figures["in_gospa"] else "the position", figures["nees_dimension"]
    expected = "" if dimension is None else f" (expected NEES: {dimension})"
    consistency_row = partial(_consistency_row, dimension=dimension)
    made = [
        Table("Cost by belief", columns(*belief, policies)),
        Table(f"Error by truth, of {error}", columns(*truth, policies)),
        Table(f"Consistency of the tracker{expected}", columns(CONSISTENCY, consistency_row, policies)),
    ]
    return [table for table in made if len(table.columns) > 1]


def titled(table: Table) -> str:
    """A table in Markdown, with its title."""
    return f"{table.title}:\n\n{aligned(table.columns)}"


def order_sentence(reversals: Sequence[Mapping[str, Any]]) -> str:
    """A sentence on the pairs found by ``consistency.reversals``, without those that round to 0."""
    reversals = [pair for pair in reversals if "0" not in (signed(pair["belief"]), signed(pair["truth"]))]
    if not reversals:
        return "Wherever both differences are significant, belief and truth rank the policies alike."
    listed = [
        f"{pair['policy']} against {pair['reference']} {signed(pair['belief'])} % by belief and "
        f"{signed(pair['truth'])} % by truth"
        for pair in reversals
    ]
    return f"Belief and truth rank these policies differently: {'; '.join(listed)}."


def aligned(columns: list[list[str]]) -> str:
    """A table of columns, each under its heading; the first is aligned to the left, the others to the right."""
    widths = [max(map(len, column)) for column in columns]
    padded = [[cell.rjust(width) for cell in column] for column, width in zip(columns, widths, strict=True)]
    padded[0] = [cell.ljust(widths[0]) for cell in columns[0]]
    lines = [f"| {' | '.join(row)} |" for row in zip(*padded, strict=True)]
    rule = "|".join(["", ":" + "-" * (widths[0] + 1), *("-" * (w + 1) + ":" for w in widths[1:]), ""])
    return "\n".join([lines[0], rule, *lines[1:]])


def tabulated(head: list[str], rows: list[list[str]]) -> str:
    """``aligned`` of a heading and rows."""
    return aligned([list(column) for column in zip(head, *rows, strict=True)])


def columns(
    head: tuple[str, ...], row: Callable[[dict[str, Any]], list[str]], policies: Mapping[str, Any]
) -> list[list[str]]:
    """A column of names and, of what ``row`` makes of each policy, the columns that have an entry."""
    every = zip(head, *([name, *row(policy)] for name, policy in policies.items()), strict=True)
    return [list(column) for column in every if any(column[1:])]


def _belief_row(policy: dict[str, Any]) -> list[str]:
    cost, against = policy["cost"], policy["vs_myopic"]
    return [
        number(cost["mean"]),
        interval(cost["ci"], number),
        signed(against["percent"]),
        interval(against["ci"], signed),
        signed(against["geometric_percent"]),
        interval(against["geometric_ci"], signed),
        decimal(policy["score"]),
        f"{policy['us_per_decision']:.1f}",
    ]


def _truth_row(policy: dict[str, Any]) -> list[str]:
    truth = policy["truth"]
    return [
        number(truth["mean"]),
        interval(truth["ci"], number),
        signed(truth["percent"]),
        interval(truth["percent_ci"], signed),
        signed(truth["geometric_percent"]),
        interval(truth["geometric_ci"], signed),
        number(truth["root"]),
        decimal(policy["lost"]),
        decimal(policy["collisions"]),
        "" if policy["share"] is None else f"{100.0 * policy['share']:.0f}",
    ]


def _consistency_row(policy: dict[str, Any], dimension: int | None) -> list[str]:
    """A policy's cells under CONSISTENCY, without its name."""
    nees, ratio = policy["nees"], policy["true_over_believed"]
    outside = nees["steps_outside"]
    return [
        flagged(nees["mean"], flag_of(Estimate(nees["mean"], nees["ci"]), dimension)),
        interval(nees["ci"], number),
        "" if outside is None else f"{100.0 * outside:.0f}",
        flagged(ratio["ratio"], flag_of_ratio(Estimate(ratio["ratio"], ratio["ci"]))),
        interval(ratio["ci"], number),
    ]


def flagged(value: float | None, flag: str) -> str:
    """A number and its flag."""
    return f"{number(value)} {flag}".strip()


def number(value: float | None) -> str:
    """Four digits, without an exponent below a million."""
    if value is None:
        return ""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:#.4g}"


def decimal(value: float | None) -> str:
    """Three decimals: targets lost per episode, and scores."""
    return "" if value is None else f"{value:.3f}"


def signed(percent: float | None) -> str:
    """A difference in per cent: one decimal, two below 1 %, none from 1000 % on."""
    if percent is None:
        return ""
    digits = 2 if abs(percent) < 1 else 1 if abs(percent) < 1000 else 0
    rounded = round(percent, digits) or 0.0  # no "-0.00"
    return f"{rounded:+.{digits}f}" if rounded else "0"


def estimated(estimate: Estimate) -> list[str]:
    """A difference in per cent and its interval."""
    return [signed(estimate.value), interval(estimate.ci, signed)]


def shared(estimate: Estimate) -> list[str]:
    """A share in per cent and its interval."""
    value = "" if estimate.value is None else f"{100.0 * estimate.value:.0f} %"
    return [value, interval(estimate.ci, lambda end: f"{100.0 * end:.0f}")]


def interval(ci: Sequence[float] | None, shown: Any) -> str:
    """Both ends, each as ``shown`` writes it; empty without an interval."""
    return "" if ci is None else f"{shown(ci[0])} to {shown(ci[1])}"
