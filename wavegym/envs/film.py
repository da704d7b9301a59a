"""Frames that explain a step: the system's own scene on the left, timelines of any system on the right.

A scene is a class that takes the system and a figure. ``wavegym.register(id, system, scene=...)`` gives it to the
system's class and its subclasses. A system without a scene gets a picture of its observation.

Matplotlib's Agg canvas draws them without pyplot: no global state changes, and equal episodes give equal pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from wavegym.core import trees
from wavegym.core.arrays import Array
from wavegym.core.registry import load_object
from wavegym.core.system import State, System
from wavegym.registration import scene_of
from wavegym.rendering.panels import Moment, Scene, caption, few_ticks, wipe

SIZE = (9.6, 6.4)  # inches; even numbers of pixels, as video encoders require
DPI = 100
SCENE_SHARE = 0.6  # of the width
HEADLINE = 11.0  # points
FITTING = 98  # characters of that size that fit the width


@dataclass
class Episode:
    """One environment's history since its last reset."""

    states: list[State] = field(default_factory=list)  # of the whole batch, at steps 0, 1, ...
    actions: list[Array] = field(default_factory=list)  # of the whole batch, one fewer
    costs: list[float] = field(default_factory=list)  # its own, one for each state


class Film:
    """Records a vector environment and draws its current step.

    Args:
        system: the closed loop.
        num_envs: number of environments.
    """

    def __init__(self, system: System, num_envs: int) -> None:
        self.system = system
        self.episodes = [Episode() for _ in range(num_envs)]
        self._canvas: Canvas | None = None

    def begin(self, state: State, rows: Array) -> None:
        """New episodes in the environments ``rows`` (bool, env), which begin at ``state``."""
        cost = self.system.cost(state.belief)
        for i in np.flatnonzero(rows):
            self.episodes[i] = Episode([state], [], [float(cost[i])])

    def add(self, state: State, actions: Array, cost: Array, restarting: Array | None) -> None:
        """A step to ``state`` with ``actions`` (env, ...); those in ``restarting`` were reset instead."""
        for i, episode in enumerate(self.episodes):
            if restarting is not None and restarting[i]:
                self.episodes[i] = Episode([state], [], [float(cost[i])])
                continue
            episode.states.append(state)
            episode.actions.append(actions)
            episode.costs.append(float(cost[i]))

    def frames(self) -> tuple[Array, ...]:
        """The current step of each environment, (height, width, 3) uint8."""
        if self._canvas is None:
            self._canvas = Canvas(self.system)
        return tuple(self._canvas.frame(self._moment(i)) for i in range(len(self.episodes)))

    def __getstate__(self) -> dict[str, Any]:
        """Without the canvas, which cannot be pickled; the copy makes a new one at its next frame."""
        return {**self.__dict__, "_canvas": None}

    def _moment(self, i: int) -> Moment:
        episode, row = self.episodes[i], np.array([i])
        states = [trees.take(state, row) for state in episode.states]
        return Moment(self.system, states, [action[row] for action in episode.actions], np.array(episode.costs))


class Canvas:
    """The figure that all frames of a film are drawn in, one after the other.

    Args:
        system: whose scene is drawn.
    """

    def __init__(self, system: System) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        from wavegym.rendering.timelines import Timelines

        figure = Figure(figsize=SIZE, dpi=DPI)
        self._agg = FigureCanvasAgg(figure)
        sides: Any = figure.subfigures(1, 2, width_ratios=(SCENE_SHARE, 1.0 - SCENE_SHARE), wspace=0.0)
        self._parts = (make_scene(system, sides[0]), Timelines(system, sides[1]))
        self._headline = figure.text(0.02, 0.955, "", fontsize=HEADLINE, fontweight="bold", va="center")

    def frame(self, moment: Moment) -> Array:
        """A frame of ``moment``, (height, width, 3) uint8."""
        for part in self._parts:
            part.draw(moment)
        text = headline(moment)
        self._headline.set(text=text, fontsize=HEADLINE * min(1.0, FITTING / len(text)))
        self._agg.draw()
        return np.asarray(self._agg.buffer_rgba())[..., :3].copy()


def headline(moment: Moment) -> str:
    """The system, the step, the waveform transmitted, and the cost after the step."""
    parts = [f"{type(moment.system).__name__}, step {len(moment.actions)} of {moment.system.horizon}"]
    if moment.actions:
        parts.append(f"transmitted: {moment.label(moment.actions[-1])}")
    return "   ·   ".join([*parts, f"cost {moment.costs[-1]:.4g}"])


if TYPE_CHECKING:
    from matplotlib.figure import SubFigure


def make_scene(system: System, figure: SubFigure) -> Scene:
    """The scene of a system, by its class. Raises an InputError for a place where there is no scene."""
    kind = scene_of(type(system)) or ObservationScene
    scene: Scene = (load_object("scene", kind) if isinstance(kind, str) else kind)(system, figure)
    return scene


class ObservationScene:
    """The fields of the observation, for a system that has no scene of its own.

    Args:
        system: the closed loop.
        figure: where to draw.
    """

    def __init__(self, system: System, figure: SubFigure) -> None:
        self._axes = figure.subplots(gridspec_kw={"left": 0.4, "right": 0.96, "top": 0.87, "bottom": 0.08})
        caption(self._axes, "observation", "(value - centre) / scale, as agents see it")
        few_ticks(self._axes)

    def draw(self, moment: Moment) -> None:
        """See ``Scene``."""
        fields = moment.system.observation_fields
        values = moment.system.observe(moment.states[-1].belief)[0]
        scaled = [(value - f.centre) / f.scale for f, value in zip(fields, values, strict=True)]
        units = ["" if f.unit == "1" else f" {f.unit}" for f in fields]
        labels = [f"{f.name} = {value:.3g}{unit}" for f, value, unit in zip(fields, values, units, strict=True)]
        wipe(self._axes)
        self._axes.barh(np.arange(len(fields)), scaled, color="tab:blue")
        self._axes.axvline(0.0, color="black", linewidth=0.6)
        self._axes.set_yticks(np.arange(len(fields)), labels, fontsize=7)
        reach = 1.1 * max(3.0, *np.abs(scaled))
        self._axes.set(xlim=(-reach, reach), ylim=(len(fields) - 0.4, -0.6))
