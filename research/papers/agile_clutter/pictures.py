"""Figures 2 and 3 of Sira et al. as pictures (PNG)."""

from __future__ import annotations

import string
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from research.papers.agile_clutter.numbers import DROP, JUMP, kind, shares, typical
from research.papers.agile_clutter.study import FREE, FULL, POLICIES, Case, Study, names, scene
from research.papers.contents import new_figure, png_bytes
from wavegym.core.arrays import Array
from wavegym.evaluation.statistics import Estimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes


INK: dict[str, Any] = {"size": "small", "color": "0.35"}
SENSORS = string.ascii_uppercase  # as the paper names them
# Okabe and Ito's
COLOURS = ("#000000", "#7f7f7f", "#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#b8a800", "#56b4e9")
LINES = ("-", "--", "-", "-", "-", "-", "-.", "-.", ":")
KIND_COLOURS = {"LFM": "#d55e00", "PFM": "#0072b2", "HFM": "#009e73", "EFM": "#cc79a7"}
SETTINGS = {"clutter": "clutter, density 10⁻⁴", "no clutter": "no clutter"}
TRACKER_NAMES = {"jpda": "JPDA", "particle": "particle filter"}


def draw_errors(study: Study, curves: Mapping[Case, Sequence[Estimate]]) -> bytes:
    """Figure 2: squared error against time, mean over kept runs with its 95 % band; a row for each tracker."""
    trackers = _trackers(study)
    figure = new_figure(11.0, 0.9 + 3.9 * len(trackers))
    grid = figure.subplots(len(trackers), 2, sharex=True, sharey=True, squeeze=False)
    for row, tracker in zip(grid, trackers, strict=True):
        for axes, (clutter, title) in zip(row, SETTINGS.items(), strict=True):
            for place, policy in enumerate(POLICIES):
                _draw_curve(axes, policy, curves[Case(tracker, clutter, policy)], place)
            axes.set_title(f"{TRACKER_NAMES[tracker]}, {title}", fontsize="medium")
            axes.set_yscale("log")
            axes.grid(alpha=0.3)
            _mark_targets(axes)
            _seconds(axes, _dt(study))
        row[0].set_ylabel("squared error of the targets\npresent, mean [m²]")
    for axes in grid[-1]:
        axes.set_xlabel("step k")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize="small")
    return png_bytes(figure)


def draw_laws(study: Study) -> bytes:
    """Figure 3: the phase functions chosen in clutter: a typical run, shares of the kept runs, and free shapes."""
    trackers = _trackers(study)
    figure = new_figure(5.8 * len(trackers), 11.0)
    grid = figure.subplots(5, len(trackers), sharex=True, squeeze=False, height_ratios=(1.2, 1, 1, 1, 1))
    for column, tracker in zip(grid.T, trackers, strict=True):
        _draw_typical(column[0], typical(study.runs[Case(tracker, "clutter", FULL)]), TRACKER_NAMES[tracker])
        for axes, (policy, sensor) in zip(column[1:], product((FULL, FREE), (0, 1)), strict=True):
            runs = study.runs[Case(tracker, "clutter", policy)]
            _draw_shares(axes, names(policy), shares(runs, len(names(policy)))[:, sensor])
            axes.set_ylabel(f"{policy}\nsensor {SENSORS[sensor]}: share", fontsize="small")
        _seconds(column[0], _dt(study))
        column[-1].set_xlabel("step k")
    handles, labels = grid[-1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=7, fontsize="small")
    return png_bytes(figure)


def _draw_curve(axes: Axes, policy: str, estimates: Sequence[Estimate], place: int) -> None:
    k = np.arange(1, len(estimates) + 1)
    mean = np.array([np.nan if e.value is None else e.value for e in estimates])
    low, high = np.array([e.ci or (np.nan, np.nan) for e in estimates]).T
    above = 1 + (policy == FULL)
    style: dict[str, Any] = {"color": COLOURS[place], "zorder": 2 + above}
    axes.plot(k, mean, LINES[place], label=policy, linewidth=0.9 + 0.5 * above, **style)
    axes.fill_between(k, low, high, alpha=0.2 if policy == FULL else 0.08, linewidth=0, **style)


def _mark_targets(axes: Axes) -> None:
    """Mark the steps at which targets appear and leave."""
    for k, text in ((JUMP, "target 2 appears"), (DROP, "target 1 leaves")):
        axes.axvline(k, color="0.6", linewidth=0.8, linestyle="--", zorder=1)
        axes.annotate(
            text, (k, 0.02), xycoords=("data", "axes fraction"), xytext=(3, 0), textcoords="offset points", **INK
        )


def _draw_typical(axes: Axes, law: Array, title: str) -> None:
    k = np.arange(1, len(law) + 1)
    for sensor, (marker, offset) in enumerate((("o", 0.12), ("s", -0.12))):
        shown = np.where(law[:, sensor] >= 0, law[:, sensor] + offset, np.nan)
        fill = "none" if sensor else "0.15"
        axes.plot(
            k, shown, marker, color="0.15", markerfacecolor=fill, markersize=4.5, label=f"sensor {SENSORS[sensor]}"
        )
    axes.set_yticks(range(len(names(FULL))), labels=names(FULL))
    axes.set_ylim(-0.6, len(names(FULL)) - 0.4)
    axes.set_ylabel("fully agile\na typical run", fontsize="small")
    axes.set_title(title, fontsize="medium")
    axes.legend(fontsize="small", loc="upper right", ncols=2)
    axes.grid(alpha=0.3)


def _draw_shares(axes: Axes, laws: Sequence[str], share: Array) -> None:
    """Stacked bars, (k, law). A kind has a colour, which is paler for later shapes of its list."""
    k, base = np.arange(1, len(share) + 1), np.zeros(len(share))
    for index, law in enumerate(laws):
        alike = [other for other in names(FREE) if kind(other) == kind(law)]
        colour = _paler(KIND_COLOURS[kind(law)], alike.index(law) / len(alike))
        axes.bar(k, share[:, index], 1.0, base, color=colour, label=law, edgecolor="white", linewidth=0.4)
        base = base + share[:, index]
    axes.set(ylim=(0, 1), xlim=(0.5, len(share) + 0.5))


def _paler(colour: str, share: float) -> Array:
    """A colour mixed with this share of white."""
    from matplotlib.colors import to_rgb

    return np.array(to_rgb(colour)) * (1.0 - share) + share


def _seconds(axes: Axes, dt: float) -> None:
    """The same axis in seconds above."""
    above = axes.secondary_xaxis("top", functions=(partial(_scaled, dt), partial(_scaled, 1.0 / dt)))
    above.set_xlabel("time [s]", fontsize="small")
    above.tick_params(labelsize="small")


def _scaled(factor: float, values: Any) -> Any:
    return factor * np.asarray(values)


def _trackers(study: Study) -> list[str]:
    return list(dict.fromkeys(tracker for tracker, _ in study.settings))


def _dt(study: Study) -> float:
    return scene(next(iter(study.runs))).dt
