"""Figures 3 to 6 of Barbosa et al. as pictures (PNG)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from research.papers.contents import new_figure, png_bytes
from research.papers.urban.motion_models import EXPECTED, LIMIT, phases
from research.papers.urban.study import CLOSED, LOOSE, NCV1, OPEN, SETTINGS, TURNS, VSIMM, Case, Study, system
from wavegym.evaluation.statistics import Estimate
from wavegym.systems.urban.state import HELD_WITHIN
from wavegym.systems.urban.system import Urban
from wavegym.systems.urban.tracker import MODELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAMES = {  # the loops in the curves
    OPEN: "open loop: round robin, NCV",
    (NCV1, TURNS): "round robin, NCV of 1 m/s²",
    (VSIMM, TURNS): "round robin, VS-IMM",
    CLOSED: "closed loop: myopic, VS-IMM",
}
COLOURS = {OPEN: "#d55e00", (NCV1, TURNS): "#009e73", (VSIMM, TURNS): "#0072b2", CLOSED: "#000000"}  # Okabe and Ito's
LINES = {OPEN: "-.", (NCV1, TURNS): ":", (VSIMM, TURNS): "--", CLOSED: "-"}
MODEL_COLOURS = dict(zip(MODELS, ("#0072b2", "#d55e00", "#009e73", "#cc79a7"), strict=True))
TITLES = {name: f"{name} starts ({vaguest:g} m)" for name, vaguest in SETTINGS.items()}
FEW = 0.1  # least share of the runs for which a curve is drawn
MARKED = (0, 40, 60, 80, 100, 140)  # scans whose numbers stand beside the path
MARGIN = 6.0  # m

Curves = Mapping[tuple[str, tuple[str, str]], Sequence[Estimate]]  # (setting, loop)
ModelCurves = Mapping[tuple[str, int, str], Sequence[Estimate]]  # (setting, target, model)


def draw_scene(study: Study) -> bytes:
    """Figure 3: the street, the path of the targets, and the confirmed tracks of the first run in either loop."""
    figure = new_figure(11.0, 7.8)
    loop = system(Case(LOOSE, True, *CLOSED))
    grid = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, of in zip(grid, (CLOSED, OPEN), strict=True):
        _draw_city(axes, loop)
        place = study.of(LOOSE, of).place[0]
        far = no_target(loop, place)
        for hit, colour, marker, label in (
            (~far, "#0072b2", "o", "confirmed track, a target within 20 m"),
            (far, "#d55e00", "x", "confirmed track of no target"),
        ):
            axes.plot(*place[hit][:, :2].T, marker, color=colour, markersize=3.5, linestyle="", label=label, zorder=4)
        axes.set_title(f"{NAMES[of]}: run 1", fontsize="medium")
        axes.set_xlabel("x [m]")
    grid[0].set_ylabel("y [m]")
    return _with_legend(figure, grid[0], columns=3)


def no_target(loop: Urban, place: Any) -> Any:
    """Which confirmed tracks at scans 1, 2, ..., (k, slot, 4), have no target within 20 m, (k, slot)."""
    truth, present = loop.scene.truth[1:, None, :, :2], loop.scene.present[1:, None]
    off = truth - place[:, :, None, :2]
    distance = np.where(present, np.hypot(off[..., 0], off[..., 1]), np.inf)
    return np.isfinite(place[..., 0]) & (distance > HELD_WITHIN).all(axis=2)


def _draw_city(axes: Axes, loop: Urban) -> None:
    for building in loop.map.buildings:
        axes.fill(*np.array(building.corners).T, facecolor="0.92", edgecolor="0.5")
    for road in loop.map.roads:
        axes.plot(*np.array(road.centre).T, color="0.85", linewidth=0.8, linestyle=(0, (8, 6)), zorder=1)
    axes.plot(*np.array(loop.map.discretes).T, "+", color="#009e73", markersize=5, label="clutter discretes")
    axes.plot(*loop.transmitters[0], "v", color="black", markersize=7, label="transmitter", zorder=5)
    places = np.array(loop.receivers).T
    axes.plot(*places, "o", color="black", markerfacecolor="white", markersize=6, label="receivers", zorder=5)
    way = loop.scene.truth[:, 0, :2]
    axes.plot(*way.T, color="0.35", linewidth=1.2, label="way of the targets", zorder=2)
    for scan in MARKED:
        axes.plot(*way[scan], "s", color="0.35", markerfacecolor="white", markersize=4, zorder=3)
        axes.annotate(
            f"{scan * loop.dt:g} s", way[scan], xytext=(-9, 9), ha="right", textcoords="offset points", size="x-small",
            zorder=6,
        )  # fmt: skip
    corners = np.concatenate([building.corners for building in loop.map.buildings])
    low, high = corners.min(axis=0) - MARGIN, corners.max(axis=0) + MARGIN
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")


def draw_confirmed(study: Study, curves: Curves) -> bytes:
    """Figure 4: confirmed tracks at each scan, mean over runs with its 95 % band."""
    figure, grid = _draw_curves(study, curves, least=0.0)
    present = system(Case(LOOSE, True, *CLOSED)).scene.present[1:].sum(axis=1)
    for axes in grid:
        k = np.arange(1, len(present) + 1)
        axes.step(k, present, where="mid", color="0.7", linewidth=3.0, zorder=0, label="targets in the street")
    grid[0].set_ylabel("confirmed tracks")
    return _with_legend(figure, grid[0])


def draw_errors(study: Study, curves: Curves) -> bytes:
    """Figure 5: RMS position error of the targets held, with its 95 % band."""
    figure, grid = _draw_curves(study, curves, least=FEW)
    grid[0].set_ylabel("RMS position error of held targets [m]")
    return _with_legend(figure, grid[0])


def _draw_curves(study: Study, curves: Curves, least: float) -> tuple[Figure, Any]:
    """All loops in both settings, at scans where at least this share of the runs holds a target."""
    figure = new_figure(11.0, 5.2)
    grid = figure.subplots(1, len(SETTINGS), sharey=True)
    for axes, setting in zip(grid, SETTINGS, strict=True):
        for loop, name in NAMES.items():
            enough = study.of(setting, loop).held.any(axis=2).mean(axis=0) >= least
            style = {"color": COLOURS[loop], "label": name, "linestyle": LINES[loop]}
            _draw_estimates(axes, curves[setting, loop], enough, style)
        axes.set_title(TITLES[setting], fontsize="medium")
        axes.set(xlabel="scan (0.25 s)", xlim=(0, len(enough)), ylim=(0, None))
        axes.grid(alpha=0.3)
    return figure, grid


def _with_legend(figure: Figure, axes: Axes, columns: int = 5) -> bytes:
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=columns, fontsize="small")
    return png_bytes(figure)


def draw_models(study: Study, curves: ModelCurves) -> bytes:
    """Figure 6: model probabilities of each target's track in the closed loop, mean over the runs that hold it."""
    targets = study.of(LOOSE, CLOSED).mu.shape[2]
    figure = new_figure(11.0, 7.0)
    grid = figure.subplots(targets, len(SETTINGS), sharex=True, sharey=True, squeeze=False)
    for column, setting in zip(grid.T, SETTINGS, strict=True):
        loop = system(Case(setting, True, *CLOSED))
        column[0].set_title(TITLES[setting], fontsize="medium")
        column[-1].set_xlabel("scan (0.25 s)")
        for target, axes in enumerate(column):
            enough = np.isfinite(study.of(setting, CLOSED).mu[:, :, target, 0]).mean(axis=0) >= FEW
            for model, colour in MODEL_COLOURS.items():
                _draw_estimates(axes, curves[setting, target, model], enough, {"color": colour, "label": model})
            for phase in phases(loop, target):
                axes.axvline(phase.first, color="0.6", linewidth=0.6)
                middle = (phase.first + phase.last) / 2
                moving = EXPECTED.get(phase.name, "")
                axes.text(middle, 1.03, f"{phase.name}\n{moving}".strip(), ha="center", va="bottom", size="x-small")
            axes.axhline(LIMIT, color="0.6", linewidth=0.6, linestyle="--")
            axes.set(xlim=(0, loop.horizon), ylim=(0, 1.22))
            axes.set_yticks(np.linspace(0, 1, 6))
    for target, axes in enumerate(grid[:, 0], 1):
        axes.set_ylabel(f"target {target}: model probability")
    return _with_legend(figure, grid[0, 0])


def _draw_estimates(axes: Axes, estimates: Sequence[Estimate], enough: Any, style: dict[str, Any]) -> None:
    """One curve with its band, at the scans (k,) with ``enough`` runs."""
    rows = [(np.nan, np.nan, np.nan) if e.value is None else (e.value, *(e.ci or (np.nan, np.nan))) for e in estimates]
    value, low, high = np.where(enough, np.array(rows).T, np.nan)
    k = np.arange(1, len(value) + 1)
    axes.plot(k, value, linewidth=1.2, **style)
    axes.fill_between(k, low, high, color=style["color"], alpha=0.15, linewidth=0)
