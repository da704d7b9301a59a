"""The scene of several targets and several sensors: map, errors, gates, pulses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.action_sets import by_sensor
from wavegym.core.arrays import Array
from wavegym.core.parameter_box import ParameterBox
from wavegym.rendering.maps import (
    CROSS,
    PLANE,
    SIGMAS,
    TRUTH,
    colour,
    cross,
    draw_hypotheses,
    draw_pulse,
    ellipse,
    fill,
)
from wavegym.rendering.panels import LINE, SMALL, Moment, caption, few_ticks, legend, wipe
from wavegym.sensors import range_and_rate, range_and_rate_jacobian
from wavegym.systems.agile_clutter.map import draw_map, illumination, known_targets
from wavegym.systems.agile_clutter.system import AgileClutter
from wavegym.waveforms import TrapezoidChirp, Waveform, parse_law

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure
    from matplotlib.gridspec import SubplotSpec


SHOWN = 2  # sensors with their own panels
GATE: dict[str, Any] = {"linewidth": 1.2}
PULSE: dict[str, Any] = {"linewidth": 1.2, "linestyle": ":"}
UPDATED: dict[str, Any] = {"alpha": 0.35}


class TargetScene:
    """Map and position errors; validation gates and ambiguity functions of the first sensors.

    A scene of a system built on this one replaces the lowest panels: ``add_lowest``, ``draw_lowest``.

    Args:
        system: the closed loop.
        figure: figure or part of one to draw into.
    """

    def __init__(self, system: AgileClutter, figure: SubFigure) -> None:
        self.system = system
        shown = min(len(system.sensors), SHOWN)
        place: dict[str, Any] = {"top": 0.865, "bottom": 0.075}
        left = figure.add_gridspec(2, 1, left=0.09, right=0.4, hspace=0.26, height_ratios=(2.3, 1.0), **place)
        place["top"] = 0.835
        right = figure.add_gridspec(shown + 1, shown, left=0.53, right=0.975, hspace=0.5, wspace=0.5, **place)
        self._map, self._errors = figure.add_subplot(left[0]), figure.add_subplot(left[1])
        self._gates = [figure.add_subplot(right[i, :]) for i in range(shown)]
        self.add_lowest(figure, right[-1, :])
        self._scan = figure.text(0.033, 0.918, "", fontsize=SMALL + 0.5, va="center")
        for axes in (self._map, self._errors, *self._gates):
            few_ticks(axes, 3)
        caption(self._map, "targets: true ×, estimated ·", "x [km]", "y [km]")
        caption(self._errors, f"estimated minus true, {SIGMAS:g}σ", "x [m]", "y [m]")
        for axes in self._gates:
            caption(axes, "", "range minus predicted [m]", "range-rate [m/s]")
            axes.yaxis.set_label_coords(-3.2 * LINE / axes.bbox.width, 0.5)
        lines: dict[str, dict[str, Any]] = {
            f"gate {system.gate:g}σ": {"color": TRUTH, **GATE},
            f"pulse alone {SIGMAS:g}σ": {"color": TRUTH, **PULSE},
            f"updated {SIGMAS:g}σ": {"color": TRUTH, "linewidth": 5, **UPDATED},
            "truth": CROSS,
        }
        legend(self._gates[0], (-0.12, 1.0 + 1.6 * LINE / self._gates[0].bbox.height), len(lines), **lines)

    def draw(self, moment: Moment) -> None:
        """See ``Scene``."""
        for axes in (self._map, self._errors, *self._gates):
            wipe(axes)
        self._scan.set_text(scan_caption(self.system, moment))
        draw_map(self._map, self.system, moment)
        self._draw_errors(moment)
        for axes in self._gates:
            axes.set_visible(bool(moment.actions))
        pulses = transmitted(self.system, moment.actions[-1])[: len(self._gates)] if moment.actions else []
        for i, pulse in enumerate(pulses):
            self._gates[i].title.set_text(f"sensor {i + 1}: {pulse.label if pulse else 'silent'}")
            self._draw_gates(self._gates[i], moment, i)
        self.draw_lowest(moment, pulses)

    def add_lowest(self, figure: SubFigure, place: SubplotSpec) -> None:
        """Add the lowest panels: the ambiguity functions of the first sensors' pulses."""
        shown = len(self._gates)
        cells = place.subgridspec(1, shown, wspace=0.5)
        self._pulses = [figure.add_subplot(cells[i]) for i in range(shown)]
        self._on_show: list[Waveform | None] = [None] * shown

    def draw_lowest(self, moment: Moment, pulses: list[Waveform | None]) -> None:
        """Draw the lowest panels; ``pulses`` is empty before the first step, None stands for a silent sensor."""
        for i, axes in enumerate(self._pulses):
            pulse = pulses[i] if pulses else None
            axes.set_visible(pulse is not None)
            self._show_pulse(i, pulse)

    def _show_pulse(self, sensor: int, pulse: Waveform | None) -> None:
        """Draw the ambiguity function. It is the slowest part, so it is redrawn only for a new pulse."""
        if pulse != self._on_show[sensor]:
            wipe(self._pulses[sensor])
            if pulse:
                draw_pulse(self._pulses[sensor], pulse, f"|χ| of sensor {sensor + 1}", small=True)
            self._on_show[sensor] = pulse

    def _draw_errors(self, moment: Moment) -> None:
        """Draw estimates and error ellipses relative to the truth."""
        axes, now = self._errors, moment.states[-1]
        axes.axhline(0.0, color=TRUTH, linewidth=0.5)
        axes.axvline(0.0, color=TRUTH, linewidth=0.5)
        reach = np.full(2, 1e-3)
        for t in known_targets(self.system, len(moment.actions)):
            truth = now.truth.targets[0, t, PLANE]
            error = now.belief.mean[0, t, PLANE] - truth
            outline = error[:, None] + ellipse(now.belief.covariance[0, t, PLANE, PLANE])
            draw_hypotheses(axes, now, t, truth)
            axes.plot(*outline, color=colour(t), linewidth=1.2)
            axes.plot(*error[:, None], "o", color=colour(t), markersize=3)
            reach = np.maximum(reach, 1.15 * np.abs(outline).max(axis=1))
        axes.set(xlim=(-reach[0], reach[0]), ylim=(-reach[1], reach[1]))

    def _draw_gates(self, axes: Axes, moment: Moment, sensor: int) -> None:
        """Draw each target's gate around the predicted measurement, with the pulse's error, the update and the truth.

        The gates are those before any sensor of this step has measured. A later sensor's own gate is smaller, but the
        state does not hold the belief between two sensors. The Jacobian carries covariances to the measurement; the
        tracker takes the unscented transform, which agrees at such distances.
        """
        system, now, position = self.system, moment.states[-1], np.array(self.system.sensors[sensor])
        before = moment.states[-2].belief
        targets = system.predicted_targets(before)
        lit, noise = system.assumed_noise(before, moment.actions[-1], sensor)
        reach = np.full(2, 1e-3)
        for t in np.flatnonzero(lit[0]).tolist():
            predicted = range_and_rate(targets.mean[0, t], position)
            N = noise[0, t]
            S = _projected(targets.mean[0, t], targets.covariance[0, t], position) + N
            gate = ellipse(S, system.gate)
            updated = range_and_rate(now.belief.mean[0, t], position) - predicted
            truth = range_and_rate(now.truth.targets[0, t], position) - predicted
            P = _projected(now.belief.mean[0, t], now.belief.covariance[0, t], position)
            axes.plot(*gate, color=colour(t), **GATE)
            axes.plot(*ellipse(N), color=colour(t), **PULSE)
            fill(axes, updated[:, None] + ellipse(P), color=colour(t), **UPDATED)
            axes.plot(*truth[:, None], **cross(t))
            for points in (gate, truth[:, None]):
                reach = np.maximum(reach, 1.1 * np.abs(points).max(axis=1))
        axes.set(xlim=(-reach[0], reach[0]), ylim=(-reach[1], reach[1]))


def _projected(mean: Array, covariance: Array, sensor: Array) -> Array:
    """Covariance of an estimate in (range, range-rate), (2, 2)."""
    H = range_and_rate_jacobian(mean, sensor)
    return H @ covariance @ H.T


def scan_caption(system: AgileClutter, moment: Moment) -> str:
    """How many returns and clutter points all sensors received in this step; the state holds no points."""
    if not moment.actions:
        return ""
    detections, clutter, effective, ancestors = moment.states[-1].truth.scan[0]
    before, sensors = moment.states[-2].belief, len(system.sensors)
    lit = illumination(system, before, moment.actions[-1])[2]
    possible = int((system.predicted_targets(before).present[0] & lit).sum())
    who = f"{sensors} sensors" if sensors > 1 else "1 sensor"
    text = f"{who}: {detections:.0f} of {possible} returns detected, {clutter:.0f} clutter points in first gates"
    if system.tracker == "particle":
        text += f"  ·  {system.particles} particles: {effective:.0f} effective, {ancestors:.0f} ancestors"
    if system.tracker == "mixture":
        used = (moment.states[-1].belief.hypotheses.weight[0] > 0.0).sum(axis=1)
        text += f"  ·  components: {', '.join(map(str, used))}"
    return text


def transmitted(system: AgileClutter, action: Array) -> list[Waveform | None]:
    """Each sensor's pulse for ``action``, (1,) or (1, ...); None for a silent sensor."""
    action_set = system.action_set
    if not isinstance(system.actions, ParameterBox):
        return [action_set.sensor_library[i] for i in by_sensor(system.actions, action)[0]]
    pulses: list[Waveform | None] = []
    for law, duration, sweep in zip(*(values[0].tolist() for values in action_set.decode_chirps(action)), strict=True):
        kind, shape = parse_law(action_set.laws[law])
        direction = "down" if sweep < 0 else "up"
        pulses.append(TrapezoidChirp(kind=kind, shape=shape, duration=duration, sweep=abs(sweep), direction=direction))
    return pulses
