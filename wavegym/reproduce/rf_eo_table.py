"""The RF/EO platforms' numbers as tables."""

from __future__ import annotations

from typing import Any

from wavegym.envs.describe import table
from wavegym.reproduce.rf_eo import ADAPTIVE
from wavegym.reproduce.words import NONE, between, between_percent, percent, written

HEAD = (
    "policy", "cost, m²", "95 %", "median", "over tuned constant", "95 %", "over myopic", "95 %", "RMSE, m", "95 %",
    "RMSE, last half", "95 %", "NEES", "PRF jumps %", "below threshold %", "us",
)  # fmt: skip
AHEAD = ("scene", "H", "cost, m²", "gain over myopic %", "95 %", "us per decision")
PENALTY = ("scene", "penalty in foresight", "cost, m²", "over logistic", "95 %", "steps with a missed measurement %")


def markdown(summary: dict[str, Any]) -> str:
    """A table of the policies for each scene, then lookahead and penalties."""
    scenes = summary["scenes"]
    parts = [f"{_title(name, scene)}\n\n{table(HEAD, _policies(scene))}" for name, scene in scenes.items()]
    ahead = [row for name, scene in scenes.items() for row in _ahead(name, scene)]
    penalties = [row for name, scene in scenes.items() for row in _penalties(name, scene)]
    parts += [
        f"Lookahead\n\n{table(AHEAD, ahead)}",
        f"Penalties, by the myopic scheduler\n\n{table(PENALTY, penalties)}",
    ]
    return "\n\n".join(parts)


def _title(name: str, scene: dict[str, Any]) -> str:
    return f"Scene: {name}, {scene['horizon']} steps"


def _policies(scene: dict[str, Any]) -> list[tuple[str, ...]]:
    return [(name, *_cells(policy)) for name, policy in scene["policies"].items()]


def _cells(policy: dict[str, Any]) -> list[str]:
    cost, nees = policy["cost"], policy["nees"]
    digits = places(cost["mean"])
    cells = [written(cost["mean"], digits), between(cost["ci"], digits), written(cost["median"], digits)]
    for key in ("over_tuned", "over_myopic"):
        cells += [written(policy[key]["ratio"], 2), between(policy[key]["ci"], 2)]
    for key in ("rmse", "rmse_late"):
        cells += [written(policy[key]["mean"], 2), between(policy[key]["ci"], 2)]
    jumps = policy["jumps"]
    each = " / ".join(percent(found["mean"]) for found in jumps["platforms"])
    cells += [written(nees["mean"], 2), f"{percent(jumps['mean'])} ({each})"]
    return [*cells, percent(policy["below_threshold"]["mean"]), written(policy["us_per_decision"], 0)]


def _ahead(name: str, scene: dict[str, Any]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = [
        (name, ADAPTIVE, _cost(scene["policies"][ADAPTIVE]), NONE, NONE, _us(scene["policies"][ADAPTIVE]))
    ]
    for depth, found in scene["lookahead"].items():
        cost = _cost(scene["policies"][f"lookahead:{depth}"])
        rows.append((name, depth, cost, written(found["percent"], 2), between(found["ci"], 2), _us(found)))
    return rows


def _penalties(name: str, scene: dict[str, Any]) -> list[tuple[str, ...]]:
    return [
        (name, penalty, _cost(found), written(found["over_logistic"]["ratio"], 3),
         between(found["over_logistic"]["ci"], 3), f"{percent(found['missed']['mean'], 2)}"
         f" ({between_percent(found['missed']['ci'], 2)})")
        for penalty, found in scene["penalties"].items()
    ]  # fmt: skip


def _cost(found: dict[str, Any]) -> str:
    return written(found["cost"]["mean"], places(found["cost"]["mean"]))


def _us(found: dict[str, Any]) -> str:
    return written(found["us_per_decision"], 0)


def places(value: float | None) -> int:
    """Digits after the point with which a cost is written."""
    return 0 if value is None or value >= 100 else 2 if value >= 1 else 3
