"""The page of the multifunction radar: tables and picture from results/loads, which ``agents.loads`` makes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents import blocks
from agents.blocks import read_results
from agents.leaderboard import ROOT
from wavegym.core.arrays import Array
from wavegym.core.files import write_whole
from wavegym.evaluation.picture import as_png
from wavegym.evaluation.table import interval, number, signed, tabulated

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FOLDER, PAGE = ROOT / "results" / "loads", ROOT / "docs" / "multifunction_radar.md"
START, END = "<!-- made by `python -m agents.loads`: -->", "<!-- loads to here -->"
PICTURE = ROOT / "docs" / "images" / "loads.png"
LOADS = (8, 16, 32, 64)
COST_PARTS = ("undetected", "tentative", "confirmed")
SIMPLE, BASE = "gain-per-second", "searched-dwell"
SHOWN = (0.05, 0.1, 0.2, 0.5)  # ticks of costs for each target
FARTHEST_SHOWN = 40.0  # per cent; the legend has the costs of policies beyond this
COLOURS = {
    "random": "0.6",
    "round-robin-search": "tab:orange",
    "earliest-deadline": "tab:olive",
    "van-keuk-blackman": "tab:green",
    SIMPLE: "tab:blue",
    "price-of-time": "tab:brown",
    "delay-index": "tab:pink",
    BASE: "black",
    "frame-greedy": "tab:cyan",
    "ppo": "tab:red",
    "ppo-scratch": "lightcoral",
    "ppo-imitation": "darkred",
}


def renew(folder: Path = FOLDER) -> None:
    """Renew the page and the picture from all results."""
    results = [found for load in LOADS if (found := read_results(folder / f"{load}.json"))]
    parts = [f"### {found['load']} targets, {found['worlds']} worlds\n\n{table(found)}" for found in results]
    planned, shifted = (read_results(folder / f"{name}.json") for name in ("planners", "shifts"))
    if planned:
        what = f"### Planners at {planned['load']} targets, {planned['worlds']} worlds of {planned['seconds']:g} s"
        parts.append(f"{what}\n\n{planners_table(planned)}")
    if shifted:
        what = f"### Changed radars and targets, {shifted['load']} targets, {shifted['worlds']} worlds"
        parts.append(f"{what}\n\n{shifts_table(shifted)}")
    blocks.renew(PAGE, START, END, "\n\n".join(parts))
    write_whole(PICTURE.parent, {PICTURE.name: picture(results, planned)})


def table(results: Mapping[str, Any]) -> str:
    """A line for each policy at one load."""
    head = [
        "policy",
        "belief",
        "95 %",
        f"% of {BASE}",
        "95 %",
        "truth",
        "95 %",
        "NEES",
        "beyond 0.99",
        "lost",
        "false",
        "confirm s",
        "search",
        "update",
        *COST_PARTS,
    ]
    rows = []
    for name, policy in results["policies"].items():
        row = [name]
        for half in ("belief", "against", "truth"):
            shown = signed if half == "against" else number
            row += [shown(policy[half]["value"]), interval(policy[half]["ci"], shown)]
        row += [f"{policy['nees']['value']:.2f}", f"{100.0 * policy['beyond']:.1f} %"]
        row += [f"{policy['lost']:.1f}", f"{policy['false_tracks']:.2f}"]
        row += [f"{policy['confirm']:.1f}"]
        row += [f"{100.0 * policy[share]:.0f} %" for share in ("searched", "updated", *COST_PARTS)]
        rows.append([*row, f"{policy['microseconds']:.0f}"])
    bound = results["bound"]
    rows.append(["lower bound", *[""] * 4, number(bound["value"]), interval(bound["ci"], number), *[""] * 11])
    for time, least in results["blind"].items():
        rows.append([f"undetected, blind search in {time}", number(least), *[""] * 16])
    return tabulated([*head, "us"], rows)


def planners_table(results: Mapping[str, Any]) -> str:
    """A line for each planner."""
    rows = []
    for name, policy in results["policies"].items():
        row = [name, number(policy["belief"]["value"]), interval(policy["belief"]["ci"], number)]
        row += [signed(policy["against"]["value"]), interval(policy["against"]["ci"], signed)]
        row += [number(policy["truth"]["value"]), f"{policy['microseconds'] / 1e3:.2g}"]
        rows.append([*row, "yes" if policy["microseconds"] < 1e6 * results["shortest_dwell"] else "no"])
    head = ["policy", "belief", "95 %", f"% of {BASE}", "95 %", "truth", "ms a decision", "real time"]
    return tabulated(head, rows)


def shifts_table(results: Mapping[str, Any]) -> str:
    """A line for each change and policy."""
    rows = []
    for shift, policies in results["shifts"].items():
        for name, policy in policies.items():
            row = [shift, name, number(policy["belief"]["value"]), interval(policy["belief"]["ci"], number)]
            row += [signed(policy["against"]["value"]), interval(policy["against"]["ci"], signed)]
            rows.append([*row, number(policy["truth"]["value"]), f"{policy['nees']['value']:.2f}"])
            shift = ""
    return tabulated(["change", "policy", "belief", "95 %", f"% of {BASE}", "95 %", "truth", "NEES"], rows)


def picture(results: list[dict[str, Any]], planned: Mapping[str, Any]) -> bytes:
    """Cost for each target against the load, by belief and by truth, and against decision time, as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    belief, truth, spent = figure.subplots(1, 3)
    for axes, half in ((belief, "belief"), (truth, "truth")):
        _against_load(axes, results, half)
    load = planned.get("load", results[-1]["load"])
    _against_time(spent, next((found for found in results if found["load"] == load), results[-1]), planned)
    figure.legend(*spent.get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize="small")
    return as_png(figure)


def _against_time(axes: Axes, result: Mapping[str, Any], planned: Mapping[str, Any]) -> None:
    """Heuristics, agents and the planners of short episodes, against the heuristic that the planners use as base."""
    shown = {name: (policy, COLOURS[name], "o") for name, policy in result["policies"].items()}
    planners = (name for name in planned.get("policies", {}) if name not in COLOURS)
    for n, name in enumerate(planners):
        shown["dwell-rollout" if n == 0 else f"_{name}"] = planned["policies"][name], "tab:purple", "s"
    for name, (policy, colour, marker) in shown.items():
        against = policy["against"]
        if against["value"] < FARTHEST_SHOWN:
            axes.errorbar(
                [policy["microseconds"]], [against["value"]], _bars([against]), fmt=marker, markersize=4,
                color=colour, label=name,
            )  # fmt: skip
        else:
            axes.plot([], [], marker, markersize=4, color=colour, label=f"{name} ({signed(against['value'])} %)")
    axes.axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
    axes.set(xscale="log", xlabel="time of a decision [us]", ylabel=f"cost at {result['load']} targets [% of {BASE}]")


def _against_load(axes: Axes, results: list[dict[str, Any]], half: str) -> None:
    loads = np.array([found["load"] for found in results])
    for name in results[0]["policies"]:
        shown = [found["policies"][name][half] for found in results]
        values = np.array([each["value"] for each in shown]) / loads
        axes.errorbar(loads, values, _bars(shown) / loads, fmt=".-", color=COLOURS[name], linewidth=1.0)
    if half == "truth":
        bounded = [found["bound"] for found in results]
        values = np.array([bound["value"] for bound in bounded]) / loads
        axes.errorbar(loads, values, _bars(bounded) / loads, fmt=".:", color="tab:purple")
        axes.annotate("lower bound", (loads[0], values[0]), (0, 6), textcoords="offset points", fontsize="small")
    axes.set(xscale="log", yscale="log", xlabel="targets", ylabel=f"cost for each target, by {half}")
    axes.set_xticks(loads, [str(load) for load in loads])
    axes.set_yticks(SHOWN, [f"{share:g}" for share in SHOWN])
    axes.minorticks_off()


def _bars(estimates: list[dict[str, Any]]) -> Array:
    """Lengths of error bars below and above, (2, n)."""
    return np.array([[each["value"] - each["ci"][0], each["ci"][1] - each["value"]] for each in estimates]).T
