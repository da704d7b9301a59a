"""The suite's environments by id, registered as strings so that ``import wavegym`` stays light."""

from __future__ import annotations

import re
from typing import Any

import gymnasium as gym

from wavegym.core.errors import InputError, check_choice, nearest
from wavegym.core.registry import import_package

NAMESPACE = "wavegym/"
SYSTEMS = {
    "wavegym/KershawEvans-v0": "wavegym.systems.kershaw_evans.system:KershawEvans",
    "wavegym/KershawEvansPosition-v0": "wavegym.systems.kershaw_evans.system:KershawEvansPosition",
    "wavegym/AgileClutter-v0": "wavegym.systems.agile_clutter.system:AgileClutter",
    "wavegym/RfEo-v0": "wavegym.systems.rf_eo.system:RfEo",
    "wavegym/RfEoFar-v0": "wavegym.systems.rf_eo.far:RfEoFar",
    "wavegym/Urban-v0": "wavegym.systems.urban.system:Urban",
    "wavegym/UrbanSignal-v0": "wavegym.systems.urban.signal:UrbanSignal",
    "wavegym/CameraSlew-v0": "wavegym.systems.camera_slew.system:CameraSlew",
    "wavegym/SectorSetup-v0": "wavegym.systems.sector_setup.system:SectorSetup",
    "wavegym/SectorSetupCity-v0": "wavegym.systems.sector_setup.city:SectorSetupCity",
    "wavegym/BeamAllocation-v0": "wavegym.systems.beam_allocation.system:BeamAllocation",
    "wavegym/EnergyBudget-v0": "wavegym.systems.energy_budget.system:EnergyBudget",
    "wavegym/EnergyBudgetKnown-v0": "wavegym.systems.energy_budget.known:EnergyBudgetKnown",
    "wavegym/MultifunctionRadar-v0": "wavegym.systems.multifunction_radar.system:MultifunctionRadar",
}

# Of an environment, not its system.
SHELL = (
    "reward",
    "forecasts",
    "measurements",
    "observation",
    "render_mode",
    "autoreset_mode",
    "num_threads",
    "scenario",
)
PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


def register(id: str, system: Any, *, max_episode_steps: int | None = None, **parameters: Any) -> None:
    """Register an environment: ``gym.make(id)`` and ``gym.make_vec(id, num_envs=...)`` then find it.

    Args:
        id: as Gymnasium's, ``"namespace/Name-v0"``.
        system: a System class or object, or ``"package.module:Class"``, which is imported by ``gym.make`` only and
            keeps the specification serialisable.
        max_episode_steps: truncate here unless ``make`` or ``make_vec`` is told otherwise.
        **parameters: parameters of the system, or settings of the environment, other than the defaults.

    Raises:
        InputError: ``system`` is none of these, or an unknown parameter (nearest named) or one out of range. The
            parameters of a ``"package.module:Class"`` are checked by ``gym.make``.
    """
    _check_system(system, {name: value for name, value in parameters.items() if name not in SHELL})
    gym.register(
        id,
        entry_point="wavegym.envs.single:make_env",
        vector_entry_point="wavegym.envs.vector:make_vector_env",
        max_episode_steps=max_episode_steps,
        kwargs={"system": system, **({"registered": parameters} if parameters else {})},
    )


def registered_system(env_id: str) -> tuple[Any, dict[str, Any]]:
    """The system of a registered id, and the parameters and settings of its registration."""
    kwargs = dict(gym.spec(env_id).kwargs)
    return kwargs.pop("system"), {**kwargs.pop("registered", {}), **kwargs}


def _check_system(system: Any, parameters: dict[str, Any]) -> None:
    """Raise an InputError for what ``gym.make`` could not build."""
    if isinstance(system, str):
        if not PATH.fullmatch(system):
            raise InputError(f"system is {system!r}, expected 'package.module:Class'")
        return
    # NumPy and pydantic, which ``import wavegym`` does without.
    from wavegym.core.build import build_system
    from wavegym.core.system import System

    if not isinstance(system, System) and not (isinstance(system, type) and issubclass(system, System)):
        raise InputError(f"system is {system!r}, expected a System, its class, or 'package.module:Class'")
    build_system(system, parameters, SHELL)


def register_suite() -> None:
    """Register the suite; a second call changes nothing."""
    for id, system in SYSTEMS.items():
        if id not in gym.registry:
            register(id, system)


def list_envs() -> list[str]:
    """The ids of the suite and of every environment registered with ``wavegym.register``."""
    return [id for id, spec in gym.registry.items() if "wavegym.envs" in str(spec.vector_entry_point)]


def stem(env_id: str) -> str:
    """The environment's name without namespace and version."""
    return env_id.rpartition("/")[2].rpartition("-v")[0]


def full_id(env_id: str) -> str:
    """The registered id of ``env_id``, with or without ``wavegym/``; ``package:id`` imports the package first.

    Raises:
        InputError: there is none; the nearest is named, or the way to an id of another package.
    """
    package, colon, rest = env_id.rpartition(":")
    if colon:
        import_package(package)
    wanted, known = rest if "/" in rest else NAMESPACE + rest, list_envs()
    if not colon and not nearest(wanted.partition("/")[0], {id.partition("/")[0] for id in known}):
        raise InputError(f"environment is {wanted!r}, expected PACKAGE:{wanted}, with the package that registers it")
    return check_choice("environment", wanted, known)
