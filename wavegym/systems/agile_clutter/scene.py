"""The scene of several targets and several sensors: map, errors, gates, pulses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.action_sets import ParameterBox, by_sensor
from wavegym.core.arrays import Array
from wavegym.core.system import State
from wavegym.rendering.maps import (
    CROSS,
    KILO,
    PLANE,
    SIGMAS,
    TRUTH,
    colour,
    cross,
    draw_hypotheses,
    draw_pulse,
    draw_track,
    ellipse,
    fill,
    to_scale,
)
from wavegym.rendering.panels import LINE, SMALL, Moment, caption, few_ticks, legend, wipe
from wavegym.sensors import range_and_rate, range_and_rate_jacobian
from wavegym.systems.agile_clutter.state import Belief
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


def known_targets(system: AgileClutter, step: int) -> list[int]:
    """Targets of which the tracker has an estimate; the first measurement comes a step after birth."""
    return [t for t, birth in enumerate(system.births) if birth <= step <= birth + system.lifetime]


def draw_map(axes: Axes, system: AgileClutter, moment: Moment) -> None:
    """Known targets with their trails, and directions to the sensors; x and y to the same scale, in km."""
    now = moment.states[-1]
    known = known_targets(system, len(moment.actions))
    centre = _fit(axes, system, now, known)
    lit = np.ones((len(system.sensors), len(system.starts)), np.bool_)
    if moment.actions:
        lit = illumination(system, moment.states[-2].belief, moment.actions[-1])[2]
    _draw_lines_of_sight(axes, system, now, [[t for t in known if row[t]] for row in lit], centre)
    for t in known:
        since = moment.states[system.births[t] :]
        truth = KILO * np.array([state.truth.targets[0, t, PLANE] for state in since])
        mean = KILO * np.array([state.belief.mean[0, t, PLANE] for state in since])
        draw_hypotheses(axes, now, t, np.zeros(2), KILO)
        draw_track(axes, t, truth, mean, _outline(now, t))


def illumination(system: AgileClutter, before: Belief, action: Array) -> tuple[Array, Array, Array]:
    """Of a step: C (sensor, 2, 2), strength (sensor,), and which sensor illuminates which target, bool."""
    pulse = system.pulse(before, action[:, None])
    return pulse.C[0, 0], pulse.strength[0, 0], pulse.chance[0, 0] > 0.0


def _outline(now: State, target: int) -> Array:
    """Error ellipse around the estimate, (2, point) in km."""
    belief = now.belief
    return KILO * (belief.mean[0, target, PLANE, None] + ellipse(belief.covariance[0, target, PLANE, PLANE]))


def _fit(axes: Axes, system: AgileClutter, now: State, known: list[int]) -> Array:
    """Set limits around all true paths of the episode and the current ellipses; the centre of the estimates, km."""
    until = [min(system.lifetime, max(system.horizon - birth, 0)) + 1 for birth in system.births]
    paths = [KILO * now.truth.path[0, t, :end, PLANE].T for t, end in enumerate(until)]
    middle = to_scale(axes, np.concatenate([*paths, *(_outline(now, t) for t in known)], axis=1))
    return KILO * now.belief.mean[0, known, PLANE].mean(axis=0) if known else middle


def _draw_lines_of_sight(axes: Axes, system: AgileClutter, now: State, lit: list[list[int]], centre: Array) -> None:
    """Lines from each sensor to the targets that it illuminates, ``lit``.

    The label stands where the line from ``centre`` leaves the map.
    """
    low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
    for i, position in enumerate(system.sensors):
        sensor = KILO * np.array(position)
        targets = KILO * now.belief.mean[0, lit[i], PLANE]
        lines = np.stack([targets, 0.0 * targets + sensor, 0.0 * targets + np.nan], axis=1)  # (target, end, 2)
        axes.plot(*lines.reshape(-1, 2).T, color=f"C{i}", linewidth=0.7, linestyle=(0, (4, 3)), alpha=0.7)
        step = sensor - centre
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.nanmin(np.where(step > 0, high - centre, low - centre) / step)
        x, y = (centre + min(share, 1.0) * step - low) / (high - low)
        if share > 1.0:  # the sensor is on the map
            axes.plot(*sensor, "^", color=f"C{i}", markersize=6)
        axes.text(
            min(max(x, 0.03), 0.97),
            min(max(y, 0.02), 0.98),
            f"to sensor {i + 1}: {np.hypot(*step):.1f} km",
            transform=axes.transAxes,
            color=f"C{i}",
            fontsize=SMALL,
            ha="left" if x < 0.3 else "right" if x > 0.7 else "center",
            va="bottom" if y < 0.5 else "top",
            bbox={"color": "white", "alpha": 0.7, "pad": 1.0},
        )


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
