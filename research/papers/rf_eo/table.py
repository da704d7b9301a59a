"""The RF/EO platforms' numbers as tables."""

from __future__ import annotations

from typing import Any

from research.papers.cells import (
    NONE,
    between,
    between_percent,
    mean_cells,
    percent,
    ratio_cells,
    share_cells,
    written,
)
from research.papers.rf_eo.study import ADAPTIVE, MARGIN, PROPOSED
from wavegym.envs.describe import table

Rows = list[tuple[str, ...]]

HEAD = (
    "policy", "cost, m²", "95 %", "median", "over tuned constant", "95 %", "over myopic", "95 %", "RMSE, m", "95 %",
    "RMSE, last half", "95 %", "NEES", "PRF jumps %", "below threshold %", "us",
)  # fmt: skip
AHEAD = ("scene", "H", "cost, m²", "gain over myopic %", "95 %", "us per decision")
PENALTY = ("scene", "penalty in prediction", "cost, m²", "over logistic", "95 %", "steps with a missed measurement %")
TUNED = ("scene", "policy", "slot", "platform", "PRF, kHz", "bandwidth, MHz", "pixel angle, mrad")
WINDOWS = ("scene", "policy", "steps", "RMSE, m", "95 %", "over the part before", "95 %", "over myopic", "95 %")
NEES = ("scene", "first step", "95 % band of a step", "all steps", "95 %", "steps in the band %", "after step 10 %")
AGREE = ("scene", "same PRF and pixel angle %", "95 %", "same PRF %", "95 %", "same pixel angle %", "95 %")
MARGINS = (
    "scene",
    "margin",
    "runs that miss a predicted measurement at the first step %",
    "95 %",
    "cost, m²",
    "median",
)


def markdown(summary: dict[str, Any]) -> str:
    """A table of the policies for each scene, then the tables that compare the scenes."""
    scenes = summary["scenes"]
    parts = [f"{_title(name, scene)}\n\n{table(HEAD, _policies(scene))}" for name, scene in scenes.items()]
    for title, head, rows in (
        ("Lookahead", AHEAD, _ahead),
        ("Penalties, by the myopic scheduler", PENALTY, _penalties),
        ("Settings that tuning finds", TUNED, _tuned),
        ("RMSE by part of the run", WINDOWS, _windows),
        ("NEES of the myopic scheduler (expected: 4)", NEES, _nees),
        ("Agreement of the two objectives, given the same belief", AGREE, _agreement),
        ("Margin of the myopic scheduler, in standard deviations", MARGINS, _margins),
    ):
        parts.append(f"{title}\n\n{table(head, [row for name, scene in scenes.items() for row in rows(name, scene)])}")
    return "\n\n".join(parts)


def _title(name: str, scene: dict[str, Any]) -> str:
    return f"Scene: {name}, {scene['horizon']} steps"


def _policies(scene: dict[str, Any]) -> Rows:
    return [(name, *_cells(policy)) for name, policy in scene["policies"].items()]


def _cells(policy: dict[str, Any]) -> list[str]:
    cost, nees = policy["cost"], policy["nees"]
    digits = places(cost["mean"])
    cells = [*mean_cells(cost, digits), written(cost["median"], digits)]
    for key in ("over_tuned", "over_myopic"):
        cells += ratio_cells(policy[key])
    for key in ("rmse", "rmse_late"):
        cells += mean_cells(policy[key])
    jumps = policy["jumps"]
    each = " / ".join(percent(found["mean"]) for found in jumps["platforms"])
    cells += [written(nees["mean"], 2), f"{percent(jumps['mean'])} ({each})"]
    return [*cells, percent(policy["below_threshold"]["mean"]), written(policy["us_per_decision"], 0)]


def _ahead(name: str, scene: dict[str, Any]) -> Rows:
    myopic = scene["policies"][ADAPTIVE]
    rows: Rows = [(name, ADAPTIVE, _cost(myopic), NONE, NONE, _us(myopic))]
    for depth, found in scene["lookahead"].items():
        cost = _cost(scene["policies"][f"lookahead:{depth}"])
        rows.append((name, depth, cost, written(found["percent"], 2), between(found["ci"], 2), _us(found)))
    return rows


def _penalties(name: str, scene: dict[str, Any]) -> Rows:
    return [
        (name, penalty, _cost(found), *ratio_cells(found["over_logistic"], 3),
         f"{percent(found['missed']['mean'], 2)} ({between_percent(found['missed']['ci'], 2)})")
        for penalty, found in scene["penalties"].items()
    ]  # fmt: skip


def _tuned(name: str, scene: dict[str, Any]) -> Rows:
    return [
        (name, policy, str(slot), str(platform), f"{prf * 1e-3:.3g}", f"{bandwidth * 1e-6:.3g}", f"{angle * 1e3:.3g}")
        for policy, slots in scene["tuned"].items()
        for slot, platforms in enumerate(slots, 1)
        for platform, (prf, bandwidth, angle) in enumerate(platforms, 1)
    ]


def _windows(name: str, scene: dict[str, Any]) -> Rows:
    return [
        (
            name, policy, f"{window['first']} to {window['last']}", *mean_cells(window),
            *((NONE, NONE) if window["fall"] is None else ratio_cells(window["fall"])),
            *ratio_cells(window["over_myopic"]),
        )
        for policy in (PROPOSED, ADAPTIVE) if policy in scene["policies"]
        for window in scene["policies"][policy]["windows"]
    ]  # fmt: skip


def _nees(name: str, scene: dict[str, Any]) -> Rows:
    found = scene["policies"][ADAPTIVE]["nees"]
    inside = (percent(found["inside"]), percent(found["inside_settled"]))
    return [(name, written(found["first"], 2), between(found["band"], 2), *mean_cells(found), *inside)]


def _agreement(name: str, scene: dict[str, Any]) -> Rows:
    return [(name, *(cell for key in ("both", "prf", "angle") for cell in share_cells(scene["agreement"][key])))]


def _margins(name: str, scene: dict[str, Any]) -> Rows:
    other = MARGIN[name]
    rows: Rows = []
    for margin, policy in ((f"{scene['margin']:g}", ADAPTIVE), (other.partition(":")[2], other)):
        found = scene["policies"][policy]
        cost, digits = found["cost"], places(found["cost"]["mean"])
        missed = share_cells(found["missed_first"])
        rows.append((name, margin, *missed, written(cost["mean"], digits), written(cost["median"], digits)))
    return rows


def _cost(found: dict[str, Any]) -> str:
    return written(found["cost"]["mean"], places(found["cost"]["mean"]))


def _us(found: dict[str, Any]) -> str:
    return written(found["us_per_decision"], 0)


def places(value: float | None) -> int:
    """Digits after the point with which a cost is written."""
    return 0 if value is None or value >= 100 else 2 if value >= 1 else 3
