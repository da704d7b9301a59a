"""The figures of Kershaw and Evans's loop as pictures (PNG)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from research.papers.contents import new_figure, png_bytes
from research.papers.kershaw_evans.closed_forms import surface
from research.papers.kershaw_evans.study import (
    BEST,
    CLOSING,
    DRAWN,
    GATE,
    LONG,
    RECEDING,
    SCENES,
    SHORT,
    TRACE,
    Case,
    Study,
    system,
)
from wavegym.evaluation.statistics import Estimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = (TRACE, GATE, BEST, LONG, SHORT)  # policies of figure 3
COLOURS = {TRACE: "#000000", GATE: "#d55e00", BEST: "#0072b2", LONG: "#009e73", SHORT: "#cc79a7"}  # Okabe and Ito's
LINES = {TRACE: "-", GATE: "-", BEST: "--", LONG: ":", SHORT: "-."}
TARGET_LINES = {CLOSING: "-", RECEDING: "--"}
LEVELS = 24
LINEAR = 0.01  # the axis is linear below this share of the widest sweep
US, MHZ = 1e6, 1e-6

Curves = Mapping[tuple[Case, str], Sequence[Estimate]]  # (case, field)


def draw_surfaces(study: Study) -> bytes:
    """Figure 1: trace and gate over the box at one belief of each scene, with the closed forms' choices."""
    figure = new_figure(11.0, 8.5)
    grid = figure.subplots(len(SCENES), 2, squeeze=False)
    for row, scene in zip(grid, SCENES, strict=True):
        loop = system(Case(scene, DRAWN, TRACE))
        for axes, policy, field in zip(row, (TRACE, GATE), ("trace", "gate"), strict=True):
            runs = study.of(scene, policy)
            k = runs.cost.shape[1] // 2
            found = surface(loop, runs.predicted[0, k], float(runs.eta[0, k]))
            values = np.log10(getattr(found, field)).T
            drawn = axes.contourf(found.duration * US, found.sweep * MHZ, values, LEVELS, cmap="viridis")
            figure.colorbar(drawn, ax=axes, label=f"log10 of {field}")
            place = runs.duration[0, k] * US, runs.sweep[0, k] * MHZ
            axes.plot(*place, "o", color="white", markeredgecolor="black", markersize=9, clip_on=False, zorder=5)
            axes.set_xscale("log")
            axes.set(xlabel="duration k [us]", ylabel="sweep [MHz]")
            axes.set_title(f"{scene}: {policy}", fontsize="medium")
    return png_bytes(figure)


def draw_pulses(study: Study, curves: Curves) -> bytes:
    """Figure 2: duration and sweep over time for closing and receding targets, mean and 95 % band of the runs."""
    figure = new_figure(11.0, 7.5)
    grid = figure.subplots(2, len(SCENES), sharex="col", squeeze=False)
    for column, scene in zip(grid.T, SCENES, strict=True):
        for axes, field, scale in zip(column, ("duration", "sweep"), (US, MHZ), strict=True):
            for targets, line in TARGET_LINES.items():
                for policy in (TRACE, GATE):
                    estimates = curves[Case(scene, targets, policy), field]
                    _draw(axes, estimates, scale, line, COLOURS[policy], f"{targets}, {policy.partition(',')[0]}")
            axes.grid(alpha=0.3)
        column[0].set_yscale("log")
        column[0].set_ylabel("duration k [us]")
        widest = max(abs(sweep) for sweep in SCENES[scene].sweeps) * MHZ
        column[1].set_yscale("symlog", linthresh=LINEAR * widest)
        column[1].set(ylabel="sweep [MHz], negative = down", xlabel="step k")
        column[0].set_title(scene, fontsize="medium")
        column[0].legend(fontsize="small")
    return png_bytes(figure)


def draw_costs(study: Study, curves: Curves) -> bytes:
    """Figure 3: trace and gate over time, schedulers and fixed pulses, mean and 95 % band of the runs."""
    figure = new_figure(11.0, 7.5)
    grid = figure.subplots(2, len(SCENES), sharex="col", squeeze=False)
    for column, scene in zip(grid.T, SCENES, strict=True):
        for axes, field in zip(column, ("cost", "gate"), strict=True):
            for policy in SHOWN:
                name = f"{policy} ({study.best[scene]})" if policy == BEST else policy
                _draw(axes, curves[Case(scene, DRAWN, policy), field], 1.0, LINES[policy], COLOURS[policy], name)
            axes.set_yscale("log")
            axes.grid(alpha=0.3)
        column[0].set_ylabel("trace(Lambda P) [m²]")
        column[1].set(ylabel="gate: sqrt(det S) [m²/s]", xlabel="step k")
        column[0].set_title(scene, fontsize="medium")
        column[0].legend(fontsize="small")
    return png_bytes(figure)


def _draw(axes: Axes, estimates: Sequence[Estimate], scale: float, line: str, colour: str, label: str) -> None:
    k = np.arange(1, len(estimates) + 1)
    value = scale * np.array([np.nan if e.value is None else e.value for e in estimates])
    low, high = scale * np.array([e.ci or (np.nan, np.nan) for e in estimates]).T
    axes.plot(k, value, line, color=colour, linewidth=1.2, label=label)
    axes.fill_between(k, low, high, color=colour, alpha=0.15, linewidth=0)
