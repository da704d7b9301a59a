"""The panels of a frame that suit any system: cost, predicted costs, choices."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core.action_sets import ParameterBox, by_sensor, sensor_count, waveform_labels
from wavegym.core.system import System
from wavegym.core.traits import UnequalSteps
from wavegym.rendering.panels import SMALL, Moment, caption, few_ticks, fit_y, legend, steps_along, wipe

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import SubFigure


COST, CHOSEN, LEAST, OTHERS = "tab:blue", "tab:red", "black", "0.6"
MOST_LABELS = 7
WIDEST = 26  # characters in a line of a label
MOST_NAMED = 6  # parameters of a box with a name in the legend
LONGEST = 1000  # in a longer episode only this number of last steps is shown
APART = 0.2  # rows between the marks of two sensors with the same waveform


class Timelines:
    """Three panels, one below the other: cost, predicted costs, choices.

    Args:
        system: the closed loop.
        figure: the figure to draw in.
    """

    def __init__(self, system: System, figure: SubFigure) -> None:
        place = {"left": 0.31, "right": 0.97, "top": 0.87, "bottom": 0.08, "hspace": 0.55}
        self._cost, self._predicted, self._choices = figure.subplots(3, 1, gridspec_kw=place)
        for axes in (self._cost, self._predicted, self._choices):
            few_ticks(axes)
        caption(self._cost, "cost after each step", "step")
        caption(self._predicted, "", "candidate, one step ahead")
        for axes in (self._cost, self._choices):
            steps_along(axes, system.horizon)
        if isinstance(system.actions, ParameterBox):
            caption(self._choices, "choices: share of each parameter's range", "step")
            names = list(system.actions.names)[:MOST_NAMED]
            self._choices.set_ylim(-0.05, 1.1 + 0.25 * -(-len(names) // 2))
            _name_lines(self._choices, names)
        else:
            caption(self._choices, "choices", "step")
            sensors = sensor_count(system.actions)
            if sensors > 1:
                _name_lines(self._choices, [f"sensor {i + 1}" for i in range(sensors)])

    def draw(self, moment: Moment) -> None:
        """Fill the panels with ``moment``."""
        for axes in (self._cost, self._predicted, self._choices):
            wipe(axes)
        if moment.system.horizon > LONGEST:
            end = max(len(moment.actions), LONGEST)
            for axes in (self._cost, self._choices):
                axes.set_xlim(end - LONGEST, end)
        self._cost.plot(moment.costs, color=COST, linewidth=1.2)
        self._cost.plot([len(moment.costs) - 1], moment.costs[-1:], "o", color=COST, markersize=4)
        fit_y(self._cost, moment.costs)
        draw_predicted(self._predicted, moment)
        if isinstance(moment.system.actions, ParameterBox):
            draw_parameters(self._choices, moment)
        else:
            draw_choices(self._choices, moment)


def draw_predicted(axes: Axes, moment: Moment) -> None:
    """The predicted cost of each candidate one step ahead; the least and the chosen candidate are marked."""
    if isinstance(moment.system, UnequalSteps):  # costs of steps of different lengths cannot be compared
        axes.set_visible(False)
        return
    belief = (moment.states[-2] if moment.actions else moment.states[-1]).belief
    try:
        candidates = moment.system.candidates()
        predicted = moment.system.cost(moment.system.predict(belief, candidates[None]))[0]
    except NotImplementedError:
        axes.set_visible(False)
        return
    least = int(np.argmin(predicted))
    axes.plot(predicted, ".", color=OTHERS, markersize=3)
    axes.plot([least], [predicted[least]], "o", color=LEAST, markersize=6, fillstyle="none")
    title = "predicted cost: least ○"
    shown = predicted
    if moment.actions:
        action = moment.actions[-1]
        cost = moment.system.cost(moment.system.predict(belief, action[:, None]))[0]
        same = np.flatnonzero((candidates.reshape(len(candidates), -1) == action.reshape(1, -1)).all(axis=1))[:1]
        if same.size:
            axes.plot(same, cost, "o", color=CHOSEN, markersize=4)
        else:
            axes.axhline(cost[0], color=CHOSEN, linewidth=1)
        title += f", chosen ● {_above(float(cost[0]), float(predicted[least]))}"
        shown = np.append(predicted, cost)
    axes.title.set_text(title)
    axes.set_xlim(-1, len(predicted))
    fit_y(axes, shown)


def draw_choices(axes: Axes, moment: Moment) -> None:
    """A row for each waveform used since the reset, and a line for each of several sensors."""
    actions: Any = moment.system.actions
    if not moment.actions:
        axes.set(yticks=[], ylim=(-0.7, 0.7))
        return
    chosen = by_sensor(actions, np.concatenate(moment.actions))  # (step, sensor)
    sensors = chosen.shape[1]
    line = "s-" if sensors > 1 else "s"
    used, rank = np.unique(chosen, return_inverse=True)
    steps = np.arange(1, len(chosen) + 1)
    for sensor, column in enumerate(rank.reshape(chosen.shape).T):
        rows = column + APART * (sensor - 0.5 * (sensors - 1))
        axes.plot(steps, rows, line, color=f"C{sensor}", linewidth=0.7, markersize=3, markeredgewidth=0)
        axes.plot(steps[-1:], rows[-1:], "o", color=CHOSEN, markersize=5)
    axes.set_ylim(-0.7, len(used) - 0.3 if sensors == 1 else 1.4 * len(used))  # room for the legend
    labelled = np.arange(len(used))[:: -(-len(used) // MOST_LABELS)]
    labels = waveform_labels(actions)
    axes.set_yticks(labelled, [fill(labels[i], WIDEST) for i in used[labelled]], fontsize=SMALL - 1.5)


def draw_parameters(axes: Axes, moment: Moment) -> None:
    """A line for each parameter of the box."""
    if moment.actions:
        chosen = np.concatenate(moment.actions)  # (step, d)
        axes.plot(np.arange(1, len(chosen) + 1), 0.5 * (chosen + 1.0), ".-", linewidth=0.7, markersize=3)


def _name_lines(axes: Axes, names: list[str]) -> None:
    """A legend of lines in the order of the colour cycle that stays in all frames."""
    legend(
        axes,
        "upper left",
        min(len(names), 2),
        **{name: {"color": f"C{i}", "marker": "."} for i, name in enumerate(names)},
    )


def _above(cost: float, least: float) -> str:
    """The difference of ``cost`` from ``least`` in per cent."""
    percent = 100.0 * (cost / least - 1.0) if least > 0 else 0.0
    return "the same" if abs(percent) < 0.05 else f"{percent:+.1f} %"
