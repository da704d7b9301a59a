"""Filmed episodes, and the marks of one colour or form in a picture, for the tests of scenes."""

from __future__ import annotations

from typing import Any

import matplotlib.colors as colours
from matplotlib.figure import Figure

from wavegym.envs import WaveformVectorEnv
from wavegym.envs.film import make_scene


def played(system: Any, steps: int, seed: int = 0, actions: Any = None, num_envs: int = 1, **settings: Any) -> Any:
    """The environment after so many steps, with drawn actions if none are given."""
    env: Any = WaveformVectorEnv(system, num_envs, **{"render_mode": "rgb_array", **settings})
    env.action_space.seed(seed)
    env.reset(seed=seed)
    for _ in range(steps):
        env.step(env.action_space.sample() if actions is None else actions)
    return env


def moment_of(env: Any, row: int = 0) -> Any:
    """What its film holds for the picture of one environment."""
    return env._film._moment(row)


def drawn(system: Any, steps: int, seed: int = 0, actions: Any = None) -> tuple[Any, Any]:
    """The scene after so many steps, and its moment."""
    moment = moment_of(played(system, steps, seed, actions))
    scene: Any = make_scene(system, Figure(figsize=(5.76, 6.4)).subfigures(1, 1))
    scene.draw(moment)
    return scene, moment


def of(shade: Any, artists: Any) -> list[Any]:
    """The artists of one colour."""
    return [a for a in artists if colours.same_color(a.get_color(), shade)]


def marked(marker: str, artists: Any) -> list[Any]:
    """The lines of one marker."""
    return [a for a in artists if a.get_marker() == marker]
