"""The settings of every environment, and its system from parameters."""

from __future__ import annotations

from typing import Any

from wavegym.core import build
from wavegym.core.errors import InputError
from wavegym.core.system import System

SETTINGS = {  # of every environment, with their meaning
    "num_envs": "number of environments, of a vector environment",
    "num_threads": "number of threads in which the environments of a vector environment advance, 1 by default; results "
    "are the same bits for any number",
    "reward": '"cost" (minus the cost: see Rewards), "log-cost" (minus its logarithm), "trace" (-trace(Lambda P), '
    'summed over the targets), "error" (minus the squared true position error), "gospa" (minus the squared GOSPA '
    'distance, where the info has it), a comparison with the myopic scheduler on the same world ("relative", '
    '"relative-log", "relative-share", "relative-scaled"), or with another heuristic ("relative:best-simple"); or a '
    "Reward of your own",
    "render_mode": 'None or "rgb_array"',
    "autoreset_mode": '"NextStep", "SameStep" or "Disabled", of a vector environment',
    "truth": "parameters in which the world differs from what the tracker and the schedulers assume, by name, such as "
    '{"q": 4.0}; the parameters that may differ are marked',
    "measurements": "whether the info of a step holds what the sensors reported: `measured_z` and so on",
    "observation": '"belief", or "measurements" for agents that remember: the time, the last action, the sensors\' own '
    "settings and what they reported last; only some systems offer it",
    "max_episode_steps": "truncate after this many steps, before the system's own end",
    "forecasts": "append the expected outcome of each candidate, one step ahead, to the observation",
    "scenario": "a TOML file with parameters and settings, of `gym.make` and `gym.make_vec`; keywords beside it win. "
    "`wavegym describe ID --toml` writes one",
}


def build_system(system: System | type[System] | str, parameters: dict[str, Any]) -> System:
    """See ``wavegym.core.build.build_system``; an unknown parameter may be meant as one of ``SETTINGS``."""
    if "scenario" in parameters:
        raise InputError("scenario is a setting of gym.make and gym.make_vec, expected it there")
    return build.build_system(system, parameters, SETTINGS)
