"""The agile chirps' numbers as a table."""

from __future__ import annotations

from typing import Any

from wavegym.envs.describe import table
from wavegym.reproduce.words import NONE, between, between_percent, percent, written

HEAD = (
    "tracker", "", "policy", "kept %", "95 %", "MSE, kept runs", "95 %", "NEES, kept runs", "95 %", "MSE, all runs",
    "median, all runs", "ratio, kept by both", "95 %", "ratio, all runs", "95 %",
)  # fmt: skip


def markdown(summary: dict[str, Any]) -> str:
    """A row for each tracker, clutter and policy; ratios are to the fully agile scheduler."""
    rows = [
        (tracker, clutter, _name(name, setting), *_cells(policy))
        for tracker, settings in summary["trackers"].items()
        for clutter, setting in settings.items()
        for name, policy in setting["policies"].items()
    ]
    return table(HEAD, rows)


def _name(policy: str, setting: dict[str, Any]) -> str:
    """The policy, and which waveforms a fixed one has."""
    constant = setting["best_fixed"].get(policy)
    return f"{policy} ({', '.join(constant['waveforms'])})" if constant else policy


def _cells(policy: dict[str, Any]) -> list[str]:
    kept, own, everything, nees = (policy[key] for key in ("kept", "mse_kept", "mse_all", "nees"))
    cells = [percent(kept["mean"]), between_percent(kept["ci"]), written(own["mean"], 0), between(own["ci"], 0)]
    cells += [written(nees["mean"], 2), between(nees["ci"], 2)]
    cells += [written(everything["mean"], 0), written(everything["median"], 0)]
    for ratio in (policy["ratio_kept"], policy["ratio_all"]):
        cells += [NONE, NONE] if ratio is None else [written(ratio["ratio"], 2), between(ratio["ci"], 2)]
    return cells
