"""What ``gym.make`` and ``gym.make_vec`` call: environments from a registration, a scenario file and keywords."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wavegym.core.system import System
from wavegym.envs.scenario import with_scenario
from wavegym.envs.single import WaveformEnv
from wavegym.envs.vector import WaveformVectorEnv


def make_env(
    system: System | type[System] | str, *, registered: Mapping[str, Any] | None = None, **given: Any
) -> WaveformEnv:
    """A single environment.

    Args:
        system: see ``WaveformVectorEnv``.
        registered: parameters and settings of the registration; the file ``given["scenario"]`` and ``given`` win.
        **given: parameters and settings; they win over the file.

    Raises:
        InputError: see ``WaveformVectorEnv`` and ``scenario_parameters``.
    """
    return WaveformEnv(system, **with_scenario(system, registered or {}, given))


def make_vector_env(
    system: System | type[System] | str, num_envs: int = 1, *, registered: Mapping[str, Any] | None = None, **given: Any
) -> WaveformVectorEnv:
    """A vector environment; see ``make_env``."""
    return WaveformVectorEnv(system, num_envs, **with_scenario(system, registered or {}, given))


make_env.metadata = WaveformEnv.metadata  # type: ignore[attr-defined]  # which Gymnasium's ``make`` reads
