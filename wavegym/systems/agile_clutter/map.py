"""The map of agile clutter: known targets with their trails, and lines of sight to the sensors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wavegym.core.arrays import Array
from wavegym.core.system import State
from wavegym.rendering.maps import KILO, PLANE, draw_hypotheses, draw_track, ellipse, to_scale
from wavegym.rendering.panels import SMALL, Moment
from wavegym.systems.agile_clutter.state import Belief
from wavegym.systems.agile_clutter.system import AgileClutter

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
