"""The street's numbers as tables."""

from __future__ import annotations

from typing import Any

from research.papers.cells import NONE, between, mean_cells, percent, ratio_cells, written
from research.papers.urban.numbers import figures_of
from research.papers.urban.study import CLOSED, GHOSTS, OPEN, SETTINGS
from wavegym.envs.describe import table

HEAD = (
    "starts", "", "loop", "confirmed", "95 %", "over open", "95 %", "RMSE, m", "95 %", "over open", "95 %", "held %",
    "seen, not held %", "losses", "false tracks a run", "95 %", "strayed / mirror / walls / other", "GOSPA, m", "95 %",
)  # fmt: skip
ABLATION = (
    "filter", "policy", "confirmed", "95 %", "over open", "95 %", "RMSE, m", "95 %", "over open", "95 %",
    "over closed", "95 %", "held %", "false tracks a run", "GOSPA, m",
)  # fmt: skip
STARTS = (
    "limit for a new track", "confirmed, closed over open", "95 %", "RMSE, closed over open", "95 %",
    "held, closed over open", "95 %", "false tracks a run, closed", "95 %", "open", "95 %",
)  # fmt: skip
MODELS = ("starts", "target", "phase", "scans", "NCV", "NCA", "CT left", "CT right", "lowest, true model", "95 %",
          "above 0.8 from scan")  # fmt: skip


def markdown(summary: dict[str, Any]) -> str:
    """Closed against open loop, then every filter with every policy, limits for new tracks, and models."""
    headline = [_headline(summary, setting, ghosts) for setting in SETTINGS for ghosts in GHOSTS]
    parts = [f"Closed against open loop\n\n{table(HEAD, [row for rows in headline for row in rows])}"]
    for setting in SETTINGS:
        systems = summary["settings"][setting]["systems"][GHOSTS[True]]
        rows = [(of, policy, *_cells(found)) for of, each in systems.items() for policy, found in each.items()]
        parts.append(f"Filter and policy, {setting} starts, with ghost logic\n\n{table(ABLATION, rows)}")
    models = [row for setting in SETTINGS for row in _models(setting, summary["settings"][setting]["models"])]
    parts.append(f"Limits for new tracks, with ghost logic\n\n{table(STARTS, _starts(summary['starts']))}")
    return "\n\n".join([*parts, f"Models, closed loop with ghost logic\n\n{table(MODELS, models)}"])


def _headline(summary: dict[str, Any], setting: str, ghosts: bool) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for name, loop in (("closed", CLOSED), ("open", OPEN)):
        found = figures_of(summary, setting, loop, ghosts)
        false, over = found["false_tracks"], found["over_open"]
        made_of = " / ".join(written(of["mean"], 2) for of in false["origins"].values())
        rows.append(
            (
                setting, GHOSTS[ghosts], name, *mean_cells(found["confirmed"]), *ratio_cells(over["confirmed"]),
                *mean_cells(found["rmse"]), *ratio_cells(over["rmse"]), percent(found["held"]["mean"]),
                percent(found["lost"]["mean"]), written(found["losses"]["mean"], 2), *mean_cells(false), made_of,
                *mean_cells(found["gospa"]),
            )
        )  # fmt: skip
    return rows


def _cells(found: dict[str, Any]) -> tuple[str, ...]:
    return (
        *mean_cells(found["confirmed"]), *ratio_cells(found["over_open"]["confirmed"]), *mean_cells(found["rmse"]),
        *ratio_cells(found["over_open"]["rmse"]), *ratio_cells(found["over_closed"]["rmse"]),
        percent(found["held"]["mean"]),
        written(found["false_tracks"]["mean"], 2), written(found["gospa"]["mean"], 2),
    )  # fmt: skip


def _starts(starts: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    return [
        (
            f"{found['vaguest']:g} m", *(cell for key in ("confirmed", "rmse", "held") for cell in
            ratio_cells(found["over_open"][key])), *mean_cells(found["false_tracks"]),
            *mean_cells(found["false_tracks_open"]),
        )
        for found in starts
    ]  # fmt: skip


def _models(setting: str, targets: list[list[dict[str, Any]]]) -> list[tuple[str, ...]]:
    return [
        (
            setting, str(target), found["phase"], f"{found['first']} to {found['last']}",
            *(written(of["mean"], 2) for of in found["mean"].values()),
            f"{found['expected']} {written(found['least']['mean'], 2)}", between(found["least"]["ci"], 2),
            str(found["known_from"] or NONE),
        )
        for target, phases in enumerate(targets, 1) for found in phases
    ]  # fmt: skip
