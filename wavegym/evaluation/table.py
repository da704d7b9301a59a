"""Results as Markdown tables, with their columns aligned for a terminal."""

from __future__ import annotations

from typing import Any

HEADERS = (
    "policy",
    "mean cost",
    "95 %",
    "mean vs myopic %",
    "95 %",
    "geometric vs myopic %",
    "95 %",
    "score",
    "RMSE m",
    "NEES",
    "lost",
    "µs/decision",
)


def markdown(summary: dict[str, Any]) -> str:
    """One row for each policy, the cheapest first. A column without any entry is left out."""
    ordered = sorted(summary["policies"].items(), key=lambda item: _or_last(item[1]["cost"]["mean"]))
    columns = [list(column) for column in zip(HEADERS, *(_row(name, p) for name, p in ordered), strict=True)]
    shown = [column for column in columns if any(column[1:])]
    settings = "".join(f", {key}={value}" for key, value in summary["settings"].items())
    worlds = f"{summary['worlds']} world{'s' * (summary['worlds'] > 1)}"
    title = f"{summary['env']}{settings}: {worlds}, seed {summary['seed']}"
    return f"{title}\n\n{aligned(shown)}"


def aligned(columns: list[list[str]]) -> str:
    """A table of columns, each under its heading; the first is aligned to the left, the others to the right."""
    widths = [max(map(len, column)) for column in columns]
    lines = [_line(row, widths) for row in zip(*columns, strict=True)]
    rule = "|".join(["", ":" + "-" * (widths[0] + 1), *("-" * (w + 1) + ":" for w in widths[1:]), ""])
    return "\n".join([lines[0], rule, *lines[1:]])


def tabulated(head: list[str], rows: list[list[str]]) -> str:
    """``aligned`` of a heading and rows."""
    return aligned([list(column) for column in zip(head, *rows, strict=True)])


def _row(name: str, policy: dict[str, Any]) -> tuple[str, ...]:
    cost, against = policy["cost"], policy["vs_myopic"]
    return (
        name,
        number(cost["mean"]),
        interval(cost["ci"], number),
        signed(against["percent"]),
        interval(against["ci"], signed),
        signed(against["geometric_percent"]),
        interval(against["geometric_ci"], signed),
        "" if policy["score"] is None else f"{policy['score']:.3f}",
        number(policy["rmse"]["mean"]),
        number(policy["nees"]),
        number(policy["lost"]),
        f"{policy['us_per_decision']:.1f}",
    )


def _line(cells: tuple[str, ...], widths: list[int]) -> str:
    padded = [cells[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(cells[1:], widths[1:], strict=True))]
    return f"| {' | '.join(padded)} |"


def number(value: float | None) -> str:
    """Four digits, without an exponent below a million."""
    if value is None:
        return ""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e6 else f"{value:#.4g}"


def signed(percent: float | None) -> str:
    """A difference in per cent: one decimal, two below 1 %, none from 1000 % on."""
    if percent is None:
        return ""
    digits = 2 if abs(percent) < 1 else 1 if abs(percent) < 1000 else 0
    rounded = round(percent, digits) or 0.0  # no "-0.00"
    return f"{rounded:+.{digits}f}" if rounded else "0"


def interval(ci: list[float] | None, shown: Any) -> str:
    """Both ends, each as ``shown`` writes it; empty without an interval."""
    return "" if ci is None else f"{shown(ci[0])} to {shown(ci[1])}"


def _or_last(value: float | None) -> float:
    return float("inf") if value is None else value
