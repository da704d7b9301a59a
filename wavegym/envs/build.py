"""Build a system from its class or name and its parameters."""

from __future__ import annotations

import dataclasses
from typing import Any

from wavegym.core.loading import load_object
from wavegym.core.parameters import make_checked
from wavegym.core.system import System

SETTINGS = {  # of every environment, with their meaning
    "num_envs": "number of environments, of a vector environment",
    "reward": '"trace" (-trace(Lambda P)), "log-trace" (-ln trace(Lambda P)), "error" (minus the squared true position '
    'error), a comparison with the myopic scheduler on the same world ("relative", "relative-log", "relative-share", '
    '"relative-scaled"), or with another heuristic ("relative:best-simple"); or a Reward of your own',
    "render_mode": 'None or "rgb_array"',
    "autoreset_mode": '"NextStep", "SameStep" or "Disabled", of a vector environment',
    "truth": "parameters in which the world differs from what the tracker and the schedulers assume, by name, such as "
    '{"q": 4.0}; the parameters that may differ are marked',
    "measurements": "whether the info of a step holds what the sensors reported: `measured_z` and so on",
    "max_episode_steps": "truncate after this many steps, before the system's own end",
    "forecasts": "append the expected outcome of each candidate, one step ahead, to the observation",
}


def build_system(system: System | type[System] | str, parameters: dict[str, Any]) -> System:
    """A system with these parameters, built from its class, ``"package.module:Class"`` or another system.

    Raises:
        InputError: no such class, an unknown parameter (nearest named) or a value out of range.
    """
    kind: Any = load_object("system", system) if isinstance(system, str) else system
    if isinstance(system, System):
        if not parameters:
            return system
        kind = type(system)
        own = {field.name: getattr(system, field.name) for field in dataclasses.fields(system) if field.init}
        parameters = {**own, **parameters}
    made: System = make_checked(kind, parameters, beside=SETTINGS)
    made.truth_model  # noqa: B018  (an invalid truth is reported here)
    return made
