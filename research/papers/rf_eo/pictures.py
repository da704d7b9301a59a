"""Figures 2, 3 and 4 of O'Rourke and Swindlehurst as pictures (PNG)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from research.papers.contents import new_figure, png_bytes
from research.papers.rf_eo.adaptation import quantiles
from research.papers.rf_eo.numbers import STATES, shown
from research.papers.rf_eo.study import (
    ADAPTIVE,
    CONSTANT,
    FAR,
    INFORMATION,
    PROPOSED,
    PUBLISHED,
    SCENES,
    Case,
    Study,
    system,
)
from wavegym.evaluation.consistency import nees_bounds
from wavegym.evaluation.statistics import Estimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TITLES = {PUBLISHED: "published", FAR: "far"}
CURVES = {PUBLISHED: (PROPOSED, CONSTANT, ADAPTIVE), FAR: (CONSTANT, INFORMATION, ADAPTIVE)}
TRACKS = {PUBLISHED: (PROPOSED, ADAPTIVE), FAR: (CONSTANT, ADAPTIVE)}
NAMES = {
    PROPOSED: "proposed fixed settings",
    CONSTANT: "tuned constant",
    ADAPTIVE: "adaptive (least trace)",
    INFORMATION: "adaptive (the paper's objective)",
}
COLOURS = {PROPOSED: "#d55e00", CONSTANT: "#0072b2", ADAPTIVE: "#000000", INFORMATION: "#009e73"}  # Okabe and Ito's
LINES = {PROPOSED: "-.", CONSTANT: "--", ADAPTIVE: "-", INFORMATION: ":"}
PLATFORM_COLOURS = ("#0072b2", "#d55e00")
PARAMETERS = (("PRF [kHz]", 1e-3), ("bandwidth [MHz]", 1e-6), ("pixel angle [mrad]", 1e3))
KM = 1e-3

Curves = Mapping[tuple[str, str, int], Sequence[Estimate]]  # (scene, policy, target)


def draw_tracks(study: Study) -> bytes:
    """Figure 2: platforms, true and estimated tracks in the world with the largest error of the fixed settings."""
    figure = new_figure(11.0, 6.0)
    for axes, scene in zip(figure.subplots(1, len(SCENES)), SCENES, strict=True):
        loop = system(Case(scene, ADAPTIVE))
        world = hardest(study, scene)
        truth = study.of(scene, ADAPTIVE).truth[world] * KM
        starts = np.array(loop.starts)[:, ::2] * KM
        for i, (start, track) in enumerate(zip(starts, np.moveaxis(truth, 1, 0), strict=True)):
            line = np.vstack([start, track])
            axes.plot(*line.T, color="0.7", linewidth=4.0, label=None if i else "true", zorder=1)
            axes.plot(*start, "o", color="0.3", markersize=5, label=None if i else "start")
            axes.annotate(f"target {i + 1}", start, xytext=(6, 6), textcoords="offset points", size="small")
            for policy in TRACKS[scene]:
                estimate = study.of(scene, policy).estimate[world, :, i] * KM
                label = None if i else NAMES[policy]
                axes.plot(*estimate.T, LINES[policy], color=COLOURS[policy], linewidth=1.0, label=label, zorder=3)
        for j, place in enumerate(np.array(loop.platforms) * KM):
            axes.plot(*place, "^", color=PLATFORM_COLOURS[j], markersize=8, label=f"platform {j + 1}")
        axes.set(xlabel="x [km]", ylabel="y [km]")
        axes.set_title(f"{TITLES[scene]}: world {world + 1}", fontsize="medium")
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small")
    return png_bytes(figure)


def draw_errors(study: Study, curves: Curves) -> bytes:
    """Figure 3: RMS position error of each target over runs with its 95 % band; below it, the NEES."""
    figure = new_figure(11.0, 10.5)
    grid = figure.subplots(3, len(SCENES), sharex="col", squeeze=False)
    for column, scene in zip(grid.T, SCENES, strict=True):
        k = shown(study.horizon(scene))
        for target, axes in enumerate(column[:2]):
            for policy in CURVES[scene]:
                _draw_curve(axes, policy, k, curves[scene, policy, target])
            axes.set_yscale("log")
            axes.set_ylabel(f"target {target + 1}: RMS\nposition error [m]")
            axes.grid(alpha=0.3)
            axes.legend(fontsize="small")
        column[0].set_title(TITLES[scene], fontsize="medium")
        _draw_nees(column[2], study, scene)
    return png_bytes(figure)


def hardest(study: Study, scene: str) -> int:
    """The world in which the fixed settings of ``TRACKS`` have the greatest error."""
    return int(np.square(study.of(scene, TRACKS[scene][0]).error).mean(axis=(1, 2)).argmax())


def _draw_curve(axes: Axes, policy: str, k: Any, estimates: Sequence[Estimate]) -> None:
    value = np.array([np.nan if e.value is None else e.value for e in estimates])
    low, high = np.array([e.ci or (np.nan, np.nan) for e in estimates]).T
    style: dict[str, Any] = {"color": COLOURS[policy], "zorder": 2 + (policy == ADAPTIVE)}
    axes.plot(k, value, LINES[policy], label=NAMES[policy], linewidth=1.2, **style)
    axes.fill_between(k, low, high, alpha=0.15, linewidth=0, **style)


def _draw_nees(axes: Axes, study: Study, scene: str) -> None:
    nees = study.of(scene, ADAPTIVE).nees
    k = np.arange(1, nees.shape[1] + 1)
    axes.plot(k, nees.mean(axis=(0, 2)), color=COLOURS[ADAPTIVE], linewidth=0.6, label=NAMES[ADAPTIVE])
    low, high = (float(end) for end in nees_bounds(nees.shape[0] * nees.shape[2], STATES))
    axes.axhspan(low, high, color="#56b4e9", alpha=0.3, label="95 % band", zorder=1)
    axes.set_ylim(0, None)
    axes.set(xlabel="step k (1 s)", ylabel="NEES, mean of\nruns and targets")
    axes.grid(alpha=0.3)
    axes.legend(fontsize="small", loc="lower right")


def draw_settings(study: Study) -> bytes:
    """Figure 4: the settings over time in the first world, and quantiles over all worlds; by scene and objective."""
    columns = [(scene, policy) for scene in SCENES for policy in (ADAPTIVE, INFORMATION)]
    figure = new_figure(14.0, 8.5)
    grid = figure.subplots(len(PARAMETERS), len(columns), sharex="col", sharey="row", squeeze=False)
    for column, (scene, policy) in zip(grid.T, columns, strict=True):
        settings = study.of(scene, policy).settings
        low, _, high = quantiles(study.of(scene, policy))
        k, bounds = np.arange(1, len(low) + 1), system(Case(scene, policy)).action_set.ranges
        for p, (axes, (label, unit)) in enumerate(zip(column, PARAMETERS, strict=True)):
            for j, colour in enumerate(PLATFORM_COLOURS):
                axes.plot(
                    k, settings[0, :, j, p] * unit, "os"[j], color=colour, markersize=1.5, label=f"platform {j + 1}"
                )
                axes.fill_between(
                    k, low[:, j, p] * unit, high[:, j, p] * unit, color=colour, alpha=0.2, linewidth=0, step="mid"
                )
            axes.set_yscale("log")
            axes.set_ylim(0.8 * bounds[p][0] * unit, 1.25 * bounds[p][1] * unit)
            axes.grid(alpha=0.3)
            if column[0] is grid[0, 0]:
                axes.set_ylabel(label)
        column[0].set_title(f"{TITLES[scene]}:\n{NAMES[policy]}", fontsize="medium")
        column[-1].set_xlabel("step k (1 s)")
    figure.legend(
        *grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize="small", markerscale=4
    )
    return png_bytes(figure)
