"""Build a system from its class or name and its parameters."""

from __future__ import annotations

import importlib
from typing import Any

from wavegym.core.errors import InputError
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
    """The system itself, or one built from its class or ``"package.module:Class"`` and parameters.

    Raises:
        InputError: no such class, an unknown parameter (nearest named) or a value out of range.
    """
    if isinstance(system, System):
        if parameters:
            raise InputError(f"parameters {sorted(parameters)} were given beside a finished system, expected its class")
        return system
    made: System = make_checked(_load(system) if isinstance(system, str) else system, parameters, beside=SETTINGS)
    made.truth_model  # noqa: B018  (an invalid truth is reported here)
    return made


def _load(path: str) -> Any:
    """The object at "package.module:name"."""
    module, _, name = path.partition(":")
    if not name:
        raise InputError(f"system is {path!r}, expected 'package.module:Class'")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise InputError(f"system is {path!r}, which cannot be loaded: {error}") from None
