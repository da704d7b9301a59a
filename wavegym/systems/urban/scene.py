"""Scene of the urban loop: map, position errors, the last scan of the first receivers, and the tracker slots."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.rendering.maps import CROSS, SIGMAS, TREE, colour, cross, draw_city, ellipse, to_scale
from wavegym.rendering.panels import LINE, SMALL, Moment, caption, few_ticks, fit_y, legend, steps_along, wipe
from wavegym.sensors import geometry_kernels, multistatic_range_and_rate
from wavegym.systems.urban.system import Urban
from wavegym.systems.urban.tracker import CONFIRMED, EMPTY, MODELS, TENTATIVE, Tracks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure


PLANE = slice(0, 2)  # x and y among [x y xdot ydot xddot yddot]
DIRECT_PATH: dict[str, Any] = {"linewidth": 0.7, "linestyle": (0, (4, 3)), "alpha": 0.6}
TRANSMITTER: dict[str, Any] = {"linestyle": "", "marker": "^", "color": "black", "markersize": 7, "markeredgewidth": 0}
RECEIVER: dict[str, Any] = {"linestyle": "", "marker": "v", "markersize": 6, "markeredgewidth": 0}
TRAIL: dict[str, Any] = {"linestyle": "", "marker": ".", "color": "black", "markersize": 2.5, "markeredgewidth": 0}
SURE: dict[str, Any] = {"color": "black", "linewidth": 1.3}
UNSURE: dict[str, Any] = {"color": "darkorange", "linewidth": 1.1, "linestyle": (0, (2, 1.2))}
SHOWN = 2  # receivers with a panel
MEASURED: dict[str, Any] = {"linestyle": "", "marker": ".", "color": "0.55", "markersize": 5, "markeredgewidth": 0}
BY_WALLS: dict[str, Any] = {"marker": "+", "markersize": 5, "markeredgewidth": 1.0, "linestyle": ""}
EXPECTED: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 8, "fillstyle": "none"}
SHADES = ("slategray", "goldenrod", "mediumseagreen", "indianred")  # of MODELS
MOST_NAMED = 8  # slots with room for a number
FAINT = 0.4  # opacity of a tentative track
LEFT: dict[str, Any] = {"left": 0.1, "right": 0.545, "top": 0.85, "bottom": 0.075}
RIGHT: dict[str, Any] = {"left": 0.66, "right": 0.975, "top": 0.825, "bottom": 0.075}
ON_MAP: dict[str, dict[str, Any]] = {
    "target": CROSS,
    f"confirmed track {SIGMAS:g}σ": {**SURE, "marker": ".", "markersize": 4},
    f"tentative track {SIGMAS:g}σ": UNSURE,
    "transmitter": TRANSMITTER,
    "receiver": {**RECEIVER, "color": "C0"},
    "tree": TREE,
}
IN_SCAN: dict[str, dict[str, Any]] = {
    "measured": MEASURED,
    "target": CROSS,
    "by walls": {**BY_WALLS, "color": "black"},
    "track": {**EXPECTED, "color": "black"},
}


def draw_urban_map(axes: Axes, system: Urban, moment: Moment) -> None:
    """Draw targets and tracks with their trails, tracks with 2 sigma ellipses; x and y have the same scale, in m.

    While the direct paths of the first two pairs are visible, lines join the target to the first transmitter and the
    receivers.
    """
    scene, step, now = system.truth_model.scene, len(moment.actions), moment.states[-1]
    driven = np.array([state.truth.targets[0, :, PLANE] for state in moment.states])
    senders = len(system.transmitters)
    antennas = np.array([*system.transmitters, *system.receivers])
    places = np.delete(antennas, range(1, senders), axis=0)
    to_scale(axes, np.concatenate([scene.truth[scene.present][:, PLANE], antennas]).T)
    draw_city(axes, system.map)
    for t in np.flatnonzero(scene.present[step]).tolist():
        trail = driven[scene.present[: step + 1, t], t]
        if scene.direct[step, t]:
            lines = np.stack([places, np.broadcast_to(trail[-1], places.shape), np.full(places.shape, np.nan)], axis=1)
            axes.plot(*lines.reshape(-1, 2).T, color=colour(t), **DIRECT_PATH)
        axes.plot(*trail.T, color=colour(t), linewidth=1.0)
        axes.plot(*trail[-1:].T, **cross(t))
        style: dict[str, Any] = {"color": colour(t), "fontsize": 10, "fontweight": "bold"}
        axes.annotate(str(t + 1), trail[-1], (7, 5), textcoords="offset points", annotation_clip=True, **style)
    confirmed = [Tracks(*state.belief[1:]).combined()[0][state.belief.status == CONFIRMED] for state in moment.states]
    axes.plot(*np.concatenate(confirmed)[:, PLANE].T, **TRAIL)
    x, P = Tracks(*now.belief[1:]).combined()
    for status, style in ((TENTATIVE, UNSURE), (CONFIRMED, SURE)):
        for slot in np.flatnonzero(now.belief.status[0] == status):
            axes.plot(*(x[0, slot, PLANE, None] + ellipse(P[0, slot, PLANE, PLANE])), **style)
    axes.plot(*antennas[:senders].T, **TRANSMITTER)
    for i, place in enumerate(antennas[senders:]):
        axes.plot(*place[:, None], color=f"C{i}", **RECEIVER)


class UrbanScene:
    """Map, position errors of held targets, the last scan of the first receivers, and the tracker slots.

    Args:
        system: the closed loop.
        figure: where to draw.
    """

    def __init__(self, system: Urban, figure: SubFigure) -> None:
        self.system = system
        left = figure.add_gridspec(2, 1, **LEFT, hspace=0.26, height_ratios=(3.0, 1.0))
        right = figure.add_gridspec(SHOWN + 1, 1, **RIGHT, hspace=0.5)
        self._map, self._errors = figure.add_subplot(left[0]), figure.add_subplot(left[1])
        self._scans = [figure.add_subplot(right[i]) for i in range(SHOWN)]
        self._slots = figure.add_subplot(right[SHOWN])
        self._scan = figure.text(0.033, 0.918, "", fontsize=SMALL + 0.5, va="center")
        for axes in (self._map, self._errors, *self._scans, self._slots):
            few_ticks(axes)
        caption(self._map, "", "x [m]", "y [m]")
        legend(self._map, "upper left", **ON_MAP)
        caption(self._errors, "position error of targets held by a confirmed track", "step", "[m]")
        steps_along(self._errors, system.horizon)
        limit = 1.05 * system.ambiguity
        for i, axes in enumerate(self._scans):
            caption(axes, f"last scan of receiver {i + 1}", "half path [m]" if i else "", "its rate [m/s]")
            axes.title.set_color(f"C{i}")
            axes.set(xlim=(0.0, system.reach), ylim=(-limit, limit))
        legend(self._scans[0], (-0.2, 1.0 + 1.6 * LINE / self._scans[0].bbox.height), len(IN_SCAN), **IN_SCAN)
        caption(self._slots, "tracks: existence, and model", "", "slot")
        names = MODELS[: len(system.urban_tracker.motion)]
        self._slots.set(xlim=(0.0, 1.0), ylim=(system.slots + 0.5, 0.5))
        self._slots.set_yticks(range(1, system.slots + 1, -(-system.slots // MOST_NAMED)))
        bars: Any = {name: {"color": shade, "linewidth": 4} for name, shade in zip(names, SHADES, strict=False)}
        legend(self._slots, "lower right", 2, **bars)

    def draw(self, moment: Moment) -> None:
        """See ``Scene``."""
        for axes in (self._map, self._errors, *self._scans, self._slots):
            wipe(axes)
        self._scan.set_text(scan_caption(self.system, moment))
        draw_urban_map(self._map, self.system, moment)
        self._draw_errors(moment)
        self._draw_slots(moment)
        for i, axes in enumerate(self._scans):
            axes.set_visible(bool(moment.actions))
            if moment.actions:
                draw_scan(axes, self.system, moment, i)

    def _draw_errors(self, moment: Moment) -> None:
        """Plot the distance from each target to the confirmed track that holds it."""
        figures = [self.system.state_info(state) for state in moment.states]
        held = np.concatenate([each["held"] for each in figures])
        error = np.concatenate([each["position_error"] for each in figures])
        for t, column in enumerate(np.where(held, error, np.nan).T):
            self._errors.plot(column, color=colour(t), linewidth=1.1)
            self._errors.plot([len(column) - 1], column[-1:], "o", color=colour(t), markersize=3)
        fit_y(self._errors, error[held] if held.any() else np.ones(1))

    def _draw_slots(self, moment: Moment) -> None:
        """Draw a bar for each track: its length is the existence probability, its colours the model probabilities."""
        belief = moment.states[-1].belief
        for slot in np.flatnonzero(belief.status[0] != EMPTY):
            ends = belief.existence[0, slot] * np.cumsum([0.0, *belief.mu[0, slot]])
            faint = 1.0 if belief.status[0, slot] == CONFIRMED else FAINT
            for a, b, shade in zip(ends[:-1], ends[1:], SHADES, strict=False):
                self._slots.barh(slot + 1, b - a, left=a, height=0.7, color=shade, alpha=faint)


def draw_scan(axes: Axes, system: Urban, moment: Moment, receiver: int) -> None:
    """Draw the measurements of a receiver, the true values of each target over all visible paths, and the tracks.

    All values belong to the first transmitter. Range-rates beyond ``system.ambiguity`` are folded, as in measurements.
    """
    scene, step, now = system.truth_model.scene, len(moment.actions), moment.states[-1]
    measured = now.truth.z[0, receiver, : now.truth.number[0, receiver]]
    axes.plot(*measured[:, :2].T, **MEASURED)
    antennas = system.transmitters[0], system.receivers[receiver]
    direct = multistatic_range_and_rate(now.truth.targets[0, :, :4], *antennas)[:, 0]
    for t in np.flatnonzero(scene.present[step]).tolist():
        every = system.pairs[receiver].measure(now.truth.targets[0, t, :4])
        seen = scene.path_index[receiver, step, t, : scene.path_count[receiver, step, t]]
        paths = folded(every[seen], system.ambiguity)
        straight = np.isclose(paths[:, 0], direct[t])
        axes.plot(*paths[~straight].T, color=colour(t), **BY_WALLS)
        axes.plot(*paths[straight].T, **cross(t))
    x, _ = Tracks(*now.belief[1:]).combined()
    for status, style in ((TENTATIVE, UNSURE), (CONFIRMED, SURE)):
        tracks = x[now.belief.status == status][:, :4]
        expected = multistatic_range_and_rate(tracks, *antennas)
        axes.plot(*folded(expected, system.ambiguity).T, color=style["color"], **EXPECTED)


def folded(z: Array, ambiguity: float) -> Array:
    """Range and range-rate (..., 2) as a pulse train measures them: rates are folded into [-ambiguity, ambiguity]."""
    return np.stack([z[..., 0], geometry_kernels.folded(z[..., 1], ambiguity)], axis=-1)


def scan_caption(system: Urban, moment: Moment) -> str:
    """Number of measurements in this step, and whether each present target is held."""
    if not moment.actions:
        return ""
    now = moment.states[-1]
    figures = {name: value[0] for name, value in system.state_info(now).items()}
    present, direct = now.truth.present[0], system.truth_model.scene.direct[len(moment.actions)]
    words = [f"{figures['measurements']} measurements"]
    held = np.where(figures["held"], "held", "not held")
    known = np.where(direct, held, np.char.add(held, ", hidden"))
    words += [f"target {t + 1}: {known[t]}" for t in np.flatnonzero(present).tolist()]
    words += [f"false tracks: {figures['false']}"] if figures["false"] else []
    return "  ·  ".join(words)
