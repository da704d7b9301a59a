"""The picture of a comparison: cost over time, and the paired difference to the baseline."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.arrays import Array
from wavegym.evaluation.comparison import BASELINE, Comparison
from wavegym.evaluation.table import signed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

Colours = dict[str, Any]

SPREAD = (5, 25, 50, 75, 95)  # percentiles over worlds: line, box, median
DECADE = 10.0  # costs that span more are drawn on a logarithmic axis
NEAR, FAR = 25.0, 200.0  # percent: where differences go beyond FAR, the axis is linear only up to NEAR


def draw(comparison: Comparison, summary: dict[str, Any]) -> bytes:
    """The picture as PNG.

    Left, over time: the cost of each policy, mean over worlds (above), and the same against the myopic scheduler
    (below). Right: for each policy the percentage by which its cost differs from the myopic one's on the same world.
    """
    from matplotlib import colormaps
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = sorted(comparison.played, key=lambda name: comparison.cost(name).mean())
    palette = colormaps["tab10" if len(names) <= 10 else "tab20"](range(20))
    colours = {name: palette[i % len(palette)] for i, name in enumerate(comparison.played)}
    figure = Figure(figsize=(11, max(5.6, 2.0 + 0.5 * len(names))), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2)
    above = figure.add_subplot(grid[0, 0])
    _draw_curves(above, figure.add_subplot(grid[1, 0], sharex=above), comparison, names, colours)
    _draw_differences(figure.add_subplot(grid[:, 1]), comparison, summary, names, colours)
    figure.legend(*above.get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize="small")
    parameters = "".join(f", {key}={value}" for key, value in summary["parameters"].items())
    worlds = f"{len(comparison.seeds)} world{'s' * (len(comparison.seeds) > 1)}, the same for every policy"
    figure.suptitle(f"{comparison.task.env_id}{parameters}: {worlds}", fontsize="medium")
    return as_png(figure)


def as_png(figure: Figure) -> bytes:
    """A figure as PNG; equal figures give equal bytes."""
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=110, metadata={"Software": None})
    return png.getvalue()


def _draw_curves(above: Axes, below: Axes, comparison: Comparison, names: list[str], colours: Colours) -> None:
    curves = {name: _curve(comparison, name) for name in names}
    reference = curves[BASELINE]
    for name in names:
        curve = curves[name]
        time = comparison.task.system.dt * np.arange(1, len(curve) + 1)
        style = {"color": colours[name], "linewidth": 1.4, "marker": "." if len(curve) == 1 else None}
        above.plot(time, curve, label=name, **style)
        both = min(len(curve), len(reference))
        below.plot(time[:both], percent_off(curve[:both], reference[:both]), **style)
    values = np.concatenate(list(curves.values()))
    values = values[np.isfinite(values)]
    if len(values) and values.min() > 0 and values.max() > DECADE * values.min():
        above.set_yscale("log")
    above.set(ylabel="cost, trace(ΛP)", title="Cost after each step, mean over worlds")
    above.tick_params(labelbottom=False)
    below.set(xlabel="time [s]", ylabel=f"against {BASELINE} [%]", title=f"The same, relative to {BASELINE}")
    _stretch(below.set_yscale, below.set_ylim, below.yaxis, below.dataLim.intervaly)
    for axes in (above, below):
        axes.grid(alpha=0.3)


def _curve(comparison: Comparison, name: str) -> Array:
    """Mean cost after each step over members and the worlds still running, (H,)."""
    longest = max(member.cost.shape[1] for member in comparison.played[name])
    total, count = np.zeros(longest), np.zeros(longest)
    for member in comparison.played[name]:
        steps = member.cost.shape[1]
        running = np.arange(steps) < member.steps[:, None]
        total[:steps] += np.where(running, member.cost, 0.0).sum(axis=0)
        count[:steps] += running.sum(axis=0)
    return total / count


def percent_off(costs: Array, reference: Array) -> Array:
    """Difference to the reference in per cent; NaN, which is not drawn, where it is not finite."""
    with np.errstate(divide="ignore", invalid="ignore"):
        percent = 100 * (costs / reference - 1)
    return np.where(np.isfinite(percent), percent, np.nan)


def _draw_differences(
    axes: Axes, comparison: Comparison, summary: dict[str, Any], names: list[str], colours: Colours
) -> None:
    """A box of the worlds for each policy, and on it the difference of the means with its interval."""
    axes.use_sticky_edges = False  # a bar that ends at 0 would put 0 on the frame
    axes.margins(x=0.08)
    reference = comparison.cost(BASELINE).mean(axis=0)
    shown = [name for name in names if name != BASELINE] or [BASELINE]
    for place, name in enumerate(reversed(shown)):
        worlds = percent_off(comparison.cost(name), reference)
        if np.isnan(worlds).all():
            axes.annotate("no finite difference", (0, place), ha="center", va="center")
            continue
        low, lower, middle, upper, high = np.nanpercentile(worlds, SPREAD)
        axes.hlines(place, low, high, color="0.4", linewidth=1)
        axes.barh(place, upper - lower, left=lower, height=0.6, color=colours[name], alpha=0.45)
        axes.vlines(middle, place - 0.3, place + 0.3, color="0.2", linewidth=1)
        percent, ci = (summary["policies"][name]["vs_myopic"][key] for key in ("percent", "ci"))
        if percent is not None:
            low, high = ci or (percent, percent)
            bar = [[percent - min(low, percent)], [max(high, percent) - percent]]
            axes.errorbar(percent, place, xerr=bar, fmt="D", color="black", markersize=5, capsize=4)
            axes.annotate(f"{signed(percent)} %", (percent, place + 0.32), ha="center", va="bottom")
    axes.axvline(0, color=colours[BASELINE], linewidth=1.4)
    axes.set_yticks(range(len(shown)), labels=list(reversed(shown)))
    axes.set_ylim(-0.6, len(shown) - 0.3)
    axes.set(
        xlabel=f"cost against {BASELINE} on the same world [%]   (left of 0: better)\n"
        "bar: middle half of the worlds with their median, line: 5 to 95 %\n"
        "black diamond: difference of the means with its 95 % interval",
        title=f"Paired difference to {BASELINE}",
    )
    _stretch(axes.set_xscale, axes.set_xlim, axes.xaxis, axes.dataLim.intervalx)
    axes.grid(axis="x", alpha=0.3)


def _stretch(set_scale: Callable[..., None], set_limits: Callable[..., Any], axis: Axis, interval: Array) -> None:
    """Show small and large differences together: the axis is linear up to NEAR per cent, logarithmic beyond."""
    low, high = interval
    if high <= FAR:
        return
    set_scale("symlog", linthresh=NEAR, linscale=1.5)
    set_limits(min(1.4 * low, -0.4 * NEAR), 3 * high)
    powers = [10.0**k for k in range(2, 12) if 10.0**k <= 3 * high]
    small = [tick for tick in (-20, -10, 0, 10, 20) if tick > 1.4 * low or tick >= -10]
    axis.set_ticks([*small, *powers], labels=[f"{tick:,.0f}" for tick in (*small, *powers)])
    axis.set_ticks([], minor=True)
