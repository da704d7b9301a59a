"""The scene of RF/EO platforms: map, position errors, and each platform's field of view and settings.

Quantities that fold are drawn folded. Their markers are filled if the radar sees the target, which is then outside the
blind zones and the notch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from wavegym.core.action_sets import quantity
from wavegym.core.arrays import Array
from wavegym.rendering.looks import draw_position_errors, prepare_position_errors
from wavegym.rendering.maps import (
    CROSS,
    KILO,
    POINTS,
    SIGMAS,
    TRUTH,
    colour,
    direction,
    draw_track,
    fill,
    sector,
    to_scale,
    trails_of,
)
from wavegym.rendering.panels import LINE, SMALL, Moment, caption, few_ticks, fit_y, legend, steps_along, wipe
from wavegym.sensors import platform_measurement
from wavegym.systems.rf_eo.system import RfEo

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure


PLANE = slice(0, None, 2)  # x and y among [x xdot y ydot]
IMAGE: dict[str, Any] = {"alpha": 0.16, "linewidth": 0.8}
UNAMBIGUOUS: dict[str, Any] = {"linewidth": 1.1, "linestyle": (0, (1.5, 1.5))}
DART = np.array([[0.0, 1.0], [0.65, -0.9], [0.0, -0.5], [-0.65, -0.9], [0.0, 1.0]])  # platform that looks along +y
SHOWN = 2  # number of platforms with a panel
ROWS = (("range", "m"), ("rate", "m/s"), ("azimuth", "rad"))
DECADE = 0.35  # drawn distance between 1, 10 and 100, relative to the distance from the centre to the edge
MOST = 1000.0  # times the edge; values farther out are drawn here
TICKS = np.array([-100.0, -1.0, 0.0, 1.0, 100.0])
INSIDE, EDGE = "0.92", "0.6"
SCALES = (1e-3, 1e3)  # Hz -> kHz, rad -> mrad
SEEN: dict[str, Any] = {"marker": "o", "linestyle": "", "markersize": 4.5, "markeredgewidth": 1.1}
MISSED: dict[str, Any] = {**SEEN, "markerfacecolor": "white"}
LEFT: dict[str, Any] = {"left": 0.09, "right": 0.47, "top": 0.85, "bottom": 0.075}
RIGHT: dict[str, Any] = {"left": 0.62, "right": 0.975, "top": 0.825, "bottom": 0.075}
LEGEND: dict[str, dict[str, Any]] = {
    "target": CROSS,
    "estimates": {"color": TRUTH, "marker": ".", "markersize": 3.5, "linestyle": ""},
    f"{SIGMAS:g}σ": {"color": TRUTH, "linewidth": 1.4},
    "platform": {"color": "C0", "marker": DART, "markersize": 8, "markeredgewidth": 0, "linestyle": ""},
    "its image": {"color": "C0", "linewidth": 5, "alpha": 2.0 * IMAGE["alpha"]},
    "range limit": {"color": "C0", **UNAMBIGUOUS},
    "in view": {"color": "0.3", **SEEN},
    "out of view": {"color": "0.3", **MISSED},
}


def draw_platform_map(axes: Axes, system: RfEo, moment: Moment) -> None:
    """Draw targets with their trails, platforms and their fields of view; x and y have the same scale, in km."""
    trails, places = trails_of(moment, PLANE, KILO), KILO * np.array(system.platforms)
    to_scale(axes, np.concatenate([places.T, trails.points], axis=1))
    _draw_fields(axes, system, moment, places)
    here = targets_shown(system, moment)
    for t in np.flatnonzero(here[-1]).tolist():
        steps = here[:, t]
        draw_track(axes, t, trails.truth[steps, t], trails.mean[steps, t], trails.outlines[t])
    looks = moment.states[-1].belief.looks[0]
    for j, place in enumerate(places):
        c, s = np.cos(looks[j]), np.sin(looks[j])
        dart = DART @ np.array([[c, -s], [s, c]])  # turned clockwise
        axes.plot(*place[:, None], marker=dart, color=f"C{j}", markersize=12, markeredgewidth=0)
        style: dict[str, Any] = {"color": f"C{j}", "fontsize": SMALL, "ha": "center", "va": "top"}
        axes.annotate(f"P{j + 1}", place, (0, -6), textcoords="offset points", **style)


def targets_shown(system: RfEo, moment: Moment) -> Array:
    """Which targets are in the scene, or enter it, at each state of the episode, (step, target) bool."""
    steps = np.array([state.belief.step[0] for state in moment.states])
    shows: Array = system.present(steps) | system.present(steps + 1)
    return shows


def _draw_fields(axes: Axes, system: RfEo, moment: Moment, places: Array) -> None:
    """Draw each platform's camera sector, out to the map's edge, and the circle of its unambiguous range.

    The sector does not end at the circle, because azimuth and range are measured independently of each other. With
    ``as_printed`` the arcsine also accepts the sector's mirror image behind the platform, which is not drawn.
    """
    if not moment.actions:
        return
    high = system.action_set.view(system.action_set.settings(moment.actions[-1]))[2][0]
    for j, (place, look) in enumerate(zip(places, moment.states[-1].belief.looks[0], strict=True)):
        fill(axes, sector(axes, place, look, min(high[j, 2], np.pi)), color=f"C{j}", **IMAGE)
        circle = place[:, None] + KILO * high[j, 0] * direction(np.linspace(0.0, 2.0 * np.pi, POINTS))
        axes.plot(*circle, color=f"C{j}", **UNAMBIGUOUS)


class PlatformScene:
    """Map, position errors, fields of view of the first platforms, and all platforms' PRFs and pixel angles.

    Args:
        system: the closed loop.
        figure: where to draw.
    """

    def __init__(self, system: RfEo, figure: SubFigure) -> None:
        self.system = system
        shown = min(len(system.platforms), SHOWN)
        left = figure.add_gridspec(2, 1, **LEFT, hspace=0.26, height_ratios=(2.2, 1.0))
        split = RIGHT["top"] - 0.225 * shown
        views = figure.add_gridspec(shown, 1, **{**RIGHT, "bottom": split + 0.01}, hspace=0.45)
        settings = figure.add_gridspec(2, 1, **{**RIGHT, "top": split - 0.095}, hspace=0.45)
        self._map, self._errors = figure.add_subplot(left[0]), figure.add_subplot(left[1])
        self._views = [figure.add_subplot(views[i]) for i in range(shown)]
        self._settings = [figure.add_subplot(settings[i]) for i in range(2)]
        self._received = figure.text(0.033, 0.918, "", fontsize=SMALL + 0.5, va="center")
        few_ticks(self._map)
        caption(self._map, "", "x [km]", "y [km]")
        legend(self._map, (-0.13, 1.0 + 0.45 * LINE / self._map.bbox.height), len(LEGEND), **LEGEND)
        prepare_position_errors(self._errors, system.horizon)
        for axes in self._views:
            _prepare_view(axes)
        self._views[-1].set_xlabel("relative to the edge of the field of view")
        names, ranges = ("PRF [kHz]", "pixel angle α [mrad]"), (system.prf, system.pixel_angle)
        for axes, name, scale, values in zip(self._settings, names, SCALES, ranges, strict=True):
            caption(axes, name, "step" if axes is self._settings[-1] else "")
            few_ticks(axes)
            steps_along(axes, system.horizon)
            fit_y(axes, scale * np.array(values))
        self._settings[0].tick_params(labelbottom=False)

    def draw(self, moment: Moment) -> None:
        """See ``Scene``."""
        for axes in (self._map, self._errors, *self._views, *self._settings):
            wipe(axes)
        self._received.set_text(received_caption(self.system, moment))
        draw_platform_map(self._map, self.system, moment)
        draw_position_errors(self._errors, moment, PLANE, targets_shown(self.system, moment))
        for axes in self._views:
            axes.set_visible(bool(moment.actions))
        if moment.actions:
            settings = self.system.action_set.settings(np.concatenate(moment.actions))  # (step, platform, 3)
            self._draw_settings(settings)
            sight = in_view(self.system, moment)
            for j, axes in enumerate(self._views):
                draw_view(axes, sight, settings[-1], j)

    def _draw_settings(self, settings: Array) -> None:
        """Draw PRF and pixel angle of every platform after each step."""
        steps = np.arange(1, len(settings) + 1)
        for axes, values, scale in zip(self._settings, (settings[..., 0], settings[..., 2]), SCALES, strict=True):
            for j, column in enumerate(scale * values.T):
                axes.plot(steps, column, ".-", color=f"C{j}", linewidth=0.7, markersize=2.5, markeredgewidth=0)
                axes.plot(steps[-1:], column[-1:], "o", color=f"C{j}", markersize=4)


class Sight(NamedTuple):
    """True quantities at every platform in the last step, folded if they fold, and the platform's field of view."""

    value: Array  # (platform, target, 3): range in m, range-rate in m/s, azimuth from the look in rad; NaN: absent
    low: Array  # (platform, 3): edges of the field of view
    high: Array  # (platform, 3)
    seen: Array  # (platform, target, 3) bool


def in_view(system: RfEo, moment: Moment) -> Sight:
    """True quantities of each target at each platform in the last step, and which of them were in view."""
    places = system.places_at(moment.states[-1].belief)[0]
    value = platform_measurement(moment.states[-1].truth.targets[0], places[:, None], system.as_printed)
    _, low, high = system.action_set.view(system.action_set.settings(moment.actions[-1])[0])
    low[:, 2], high[:, 2] = np.maximum(low[:, 2], -np.pi), np.minimum(high[:, 2], np.pi)  # the full circle
    ahead = moment.states[-2].belief.mean[0] @ system.motion.F.T
    predicted = platform_measurement(ahead, places[:, None], system.as_printed)
    blind = np.minimum(value[..., :1], predicted[..., :1]) < system.nearest_range
    seen = (value >= low[:, None]) & (value <= high[:, None]) & ~blind
    if system.folding:
        value, visible = system.folded(value, high[:, None])
        seen[..., :2] = visible[..., None] & ~blind
    here = targets_shown(system, moment)[-1][:, None]
    return Sight(np.where(here, value, np.nan), low, high, seen & here)


def draw_view(axes: Axes, sight: Sight, settings: Array, platform: int) -> None:
    """Draw each quantity of each target relative to the upper edge of the field of view, which is shaded.

    Args:
        axes: the platform's panel.
        sight: quantities and fields of view of all platforms.
        settings: PRF in Hz, bandwidth in Hz and pixel angle in rad of every platform, (platform, 3 or 4).
        platform: number of the platform.
    """
    prf, bandwidth, angle = settings[platform, :3].tolist()
    words = f"PRF {quantity(prf, 'Hz')}, B {quantity(bandwidth, 'Hz')}, α {quantity(angle, 'rad')}"
    axes.title.set(text=f"P{platform + 1}: {words}", color=f"C{platform}")
    value, low, high, seen = (field[platform] for field in sight)
    targets = len(value)
    names = []
    for q, (name, unit) in enumerate(ROWS):
        left = low[q] / high[q] if np.isfinite(low[q]) else 0.0
        names.append(f"{name}\n{'±' if left < 0.0 else '≤'} {quantity(float(high[q]), unit)}")
        box = np.array([[left, left, 1.0, 1.0], [q - 0.46, q + 0.46, q + 0.46, q - 0.46]])
        fill(axes, box, facecolor=INSIDE, edgecolor=EDGE, linewidth=0.6)
    axes.plot([0.0, 0.0], [-0.5, 2.5], color=EDGE, linewidth=0.6)
    for t in range(targets):
        rows = np.arange(3) + 0.8 * ((t + 0.5) / targets - 0.5)
        at, inside, shade = place_of(value[t] / high), seen[t], colour(t)
        axes.plot(np.stack([0.0 * at, at]), np.stack([rows, rows]), color=shade, linewidth=0.9)
        axes.plot(at[inside], rows[inside], color=shade, **SEEN)
        axes.plot(at[~inside], rows[~inside], color=shade, **MISSED)
    axes.set_yticks(range(3), names)


def place_of(ratio: Any) -> Any:
    """Drawing position of a quantity relative to the edge: linear up to the edge, logarithmic beyond."""
    size = np.clip(np.abs(ratio), 1e-12, MOST)
    return np.sign(ratio) * np.where(size <= 1.0, size, 1.0 + DECADE * np.log10(size))


def _prepare_view(axes: Axes) -> None:
    """Draw the parts of a field-of-view panel that stay the same in all frames."""
    reach = 1.05 * float(place_of(MOST))
    caption(axes, "")
    axes.title.set_x(0.36)
    axes.set(xlim=(-reach, reach), ylim=(2.55, -0.55))
    axes.set_xticks(place_of(TICKS), [f"{tick:g}" for tick in TICKS])
    axes.tick_params(axis="y", length=0)


def received_caption(system: RfEo, moment: Moment) -> str:
    """Number of quantities measured of each target in this step, or the steps since its last measurement."""
    if not moment.actions:
        return ""
    truth, most = moment.states[-1].truth, 3 * len(system.platforms)
    counts, here = [], system.present(moment.states[-1].belief.step)[0]
    for t, (received, unseen) in enumerate(zip(truth.received[0].tolist(), truth.unseen[0].tolist(), strict=True)):
        known = f"{received} of {most}" if received else f"nothing for {unseen} step{'s' * (unseen > 1)}"
        counts.append(f"target {t + 1}: {known if here[t] else 'absent'}")
    return "quantities measured:  " + "  ·  ".join(counts)
