"""One record an id: the suite's environments, and those that other packages register.

Records hold strings, so that ``import wavegym`` stays light. The environments' pages, the navigation of the docs, the
API list, README's table and the commands' lists follow the order of ``SYSTEMS``.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import gymnasium as gym

from wavegym.core.errors import InputError, check_choice, nearest
from wavegym.core.registry import import_package

NAMESPACE = "wavegym/"
NOTHING: Mapping[str, Any] = MappingProxyType({})


class Registration(NamedTuple):
    """The record of an id, known before its environment is made.

    Attributes:
        system: a System class or object, or ``"package.module:Class"``.
        scene: class of the picture of this system and of its subclasses, or ``"package.module:Class"``; "" leaves the
            picture of the base class, or of the observation.
        parameters: of the system, or settings of the environment, other than the defaults.
        settings: training settings by algorithm, ``{"ppo": {"gamma": 0.98}}``, other than those of every environment.
            Those of the suite stand in ``wavegym/learning/settings.toml``.
        tier: what the environment is for, one of ``TIERS``; "" leaves it open.
        grades: the parameter that sets the difficulty, and its values from easy to hard, ``{"targets": (2, 4, 8)}``.
    """

    system: Any
    scene: Any = ""
    parameters: Mapping[str, Any] = NOTHING
    settings: Mapping[str, Mapping[str, Any]] = NOTHING
    tier: str = ""
    grades: Mapping[str, tuple[Any, ...]] = NOTHING


TIERS = {
    "benchmark": "the best known policy costs more than 4 % less than the best heuristic, with an interval off zero. "
    "Averages count these environments only",
    "papers": "replicas of the papers' loops. No policy is known that is much better than the best heuristic",
    "open": "it is not known whether much is left to gain over the best heuristic",
}


LOOPS = "wavegym.systems"
SYSTEMS = {
    "wavegym/KershawEvans-v0": Registration(
        f"{LOOPS}.kershaw_evans.system:KershawEvans", f"{LOOPS}.kershaw_evans.scene:LineOfSightScene", tier="papers"
    ),
    "wavegym/KershawEvansPosition-v0": Registration(
        f"{LOOPS}.kershaw_evans.system:KershawEvansPosition", tier="papers"
    ),
    "wavegym/AgileClutter-v0": Registration(
        f"{LOOPS}.agile_clutter.system:AgileClutter", f"{LOOPS}.agile_clutter.scene:TargetScene", tier="papers"
    ),
    "wavegym/RfEo-v0": Registration(f"{LOOPS}.rf_eo.system:RfEo", f"{LOOPS}.rf_eo.scene:PlatformScene", tier="papers"),
    "wavegym/RfEoFar-v0": Registration(f"{LOOPS}.rf_eo.system:RfEoFar", tier="papers"),
    "wavegym/Urban-v0": Registration(f"{LOOPS}.urban.system:Urban", f"{LOOPS}.urban.scene:UrbanScene", tier="papers"),
    "wavegym/UrbanSignal-v0": Registration(f"{LOOPS}.urban.system:UrbanSignal", tier="papers"),
    "wavegym/CameraSlew-v0": Registration(
        f"{LOOPS}.camera_slew.system:CameraSlew",
        f"{LOOPS}.camera_slew.scene:CameraScene",
        tier="benchmark",
        grades={"targets": (2, 3, 4, 6)},
    ),
    "wavegym/SectorSetup-v0": Registration(
        f"{LOOPS}.sector_setup.system:SectorSetup",
        f"{LOOPS}.sector_setup.scene:SectorScene",
        tier="benchmark",
        grades={"targets": (2, 3, 4, 6)},
    ),
    "wavegym/SectorSetupCity-v0": Registration(
        f"{LOOPS}.sector_setup.city:SectorSetupCity", f"{LOOPS}.sector_setup.scene:CityScene", tier="open"
    ),
    "wavegym/BeamAllocation-v0": Registration(
        f"{LOOPS}.beam_allocation.system:BeamAllocation", f"{LOOPS}.beam_allocation.scene:BeamScene", tier="open"
    ),
    "wavegym/EnergyBudget-v0": Registration(
        f"{LOOPS}.energy_budget.system:EnergyBudget", f"{LOOPS}.energy_budget.scene:AccountScene", tier="open"
    ),
    "wavegym/EnergyBudgetKnown-v0": Registration(
        f"{LOOPS}.energy_budget.known:EnergyBudgetKnown", tier="benchmark", grades={"budget": (0.12, 0.06, 0.03)}
    ),
    "wavegym/MultifunctionRadar-v1": Registration(
        f"{LOOPS}.multifunction_radar.system:MultifunctionRadar",
        f"{LOOPS}.multifunction_radar.scene:RegionScene",
        tier="open",
    ),
    "wavegym/SharedSpectrum-v0": Registration(
        f"{LOOPS}.shared_spectrum.system:SharedSpectrum", f"{LOOPS}.shared_spectrum.scene:BandScene", tier="benchmark"
    ),
}
RECORDS: dict[str, Registration] = {}  # of every id that ``register`` was given

SETTINGS = {  # of every environment, with their meaning
    "num_envs": "number of environments, of a vector environment",
    "num_threads": "number of threads in which the environments of a vector environment advance, 1 by default; results "
    "are the same bits for any number",
    "reward": '"cost" (minus the cost: see Rewards), "scaled" (the same over one number, the cost of myopic), '
    '"log-cost" (minus its logarithm), "trace" (-trace(Lambda P), summed over the targets), "error" (minus the squared '
    'true position error), "gospa" (minus the squared GOSPA distance, where the info has it), a comparison with the '
    'myopic scheduler on the same world ("relative", "relative-log", "relative-share", "relative-scaled"), or with '
    'another heuristic ("relative:best-simple"); or a Reward of your own',
    "render_mode": 'None or "rgb_array"',
    "autoreset_mode": '"NextStep", "SameStep" or "Disabled", of a vector environment',
    "truth": "parameters in which the world differs from what the tracker and the schedulers assume, by name, such as "
    '{"q": 4.0}; the parameters that may differ are marked',
    "measurements": "whether the info of a step holds what the sensors reported: `measured_z` and so on",
    "observation": '"belief", or "measurements" for agents that remember: the time, the last action, the sensors\' own '
    "settings and what they reported last; only some systems offer it",
    "max_episode_steps": "truncate after this many steps, before the system's own end",
    "forecasts": "append the expected outcome of each candidate, one step ahead, to the observation",
    "candidates": "K: the action is one index into a list of K actions, the choice of myopic first and then others in "
    "the order of their expected cost; the observation has the forecasts of these. Where a library has at most K "
    "actions, the action stays an index into it",
    "scenario": "a TOML file with parameters and settings, of `gym.make` and `gym.make_vec`; keywords beside it win. "
    "`wavegym describe ID --toml` writes one",
}
# Those among the parameters of a registration that its system does not take.
SHELL = tuple(name for name in SETTINGS if name not in ("num_envs", "truth", "max_episode_steps"))
PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


def register(
    id: str,
    system: Any,
    *,
    max_episode_steps: int | None = None,
    scene: Any = "",
    settings: Mapping[str, Mapping[str, Any]] = NOTHING,
    tier: str = "",
    grades: Mapping[str, tuple[Any, ...]] = NOTHING,
    **parameters: Any,
) -> None:
    """Register an environment: ``gym.make(id)`` and ``gym.make_vec(id, num_envs=...)`` then find it.

    Args:
        id: as Gymnasium's, ``"namespace/Name-v0"``.
        system: a System class or object, or ``"package.module:Class"``, which is imported by ``gym.make`` only and
            keeps the specification serialisable.
        max_episode_steps: truncate here unless ``make`` or ``make_vec`` is told otherwise.
        scene, settings, tier, grades: see ``Registration``.
        **parameters: parameters of the system, or settings of the environment, other than the defaults.

    Raises:
        InputError: an invalid system, parameter (``gym.make`` checks those of a ``"package.module:Class"``) or tier, or
            another id gave the class of ``system`` a scene; grades that are no values of a parameter of the system.
    """
    _check_system(system, {name: value for name, value in parameters.items() if name not in SHELL})
    if tier:
        check_choice("tier", tier, TIERS)
    _check_grades(system, grades)
    record = Registration(system, scene, parameters, settings, tier, grades)
    for other, known in RECORDS.items():
        if scene and known.scene not in ("", scene) and known.system == system and other != id:
            raise InputError(f"scene of {id} is {scene!r}, expected none: {other} gives its system {known.scene!r}")
    gym.register(
        id,
        entry_point="wavegym.envs.single:make_env",
        vector_entry_point="wavegym.envs.vector:make_vector_env",
        max_episode_steps=max_episode_steps,
        kwargs={"system": system, **({"registered": parameters} if parameters else {})},
    )
    RECORDS[id] = record


def scene_of(kind: type) -> Any:
    """The scene that the records give a class of systems, or the nearest of its base classes; "" for none."""
    scenes = {_class_of(record.system): record.scene for record in reversed(RECORDS.values()) if record.scene}
    return next((scenes[each] for each in kind.__mro__ if each in scenes), "")


def _class_of(system: Any) -> Any:
    """The class of a record's system, or None for a string that nobody has imported yet."""
    if isinstance(system, str):
        module, _, name = system.partition(":")
        return getattr(sys.modules.get(module), name, None)
    return system if isinstance(system, type) else type(system)


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
    from wavegym.core.system import System, build_system

    if not isinstance(system, System) and not (isinstance(system, type) and issubclass(system, System)):
        raise InputError(f"system is {system!r}, expected a System, its class, or 'package.module:Class'")
    build_system(system, parameters, SHELL)


def _check_grades(system: Any, grades: Any) -> None:
    """Raise an InputError unless these are values by name, of parameters if the system's class is known."""
    wanted = "values of a parameter from easy to hard, such as {'targets': (2, 4, 8)}"
    if not isinstance(grades, Mapping) or not all(
        isinstance(values, (tuple, list)) and values for values in grades.values()
    ):
        raise InputError(f"grades is {grades!r}, expected {wanted}")
    if grades and not isinstance(system, str):
        from wavegym.core.parameters import parameter_infos

        names = [info.name for info in parameter_infos(system if isinstance(system, type) else type(system))]
        for name in grades:
            check_choice("a parameter of grades", name, names)


def register_suite() -> None:
    """Register the suite; a second call changes nothing."""
    for id, record in SYSTEMS.items():
        if id not in gym.registry:
            own = record._asdict()
            register(id, own.pop("system"), **own.pop("parameters"), **own)


def list_envs() -> list[str]:
    """The ids of the suite and of every environment registered with ``wavegym.register``."""
    return [id for id, spec in gym.registry.items() if "wavegym.envs" in str(spec.vector_entry_point)]


def stem(env_id: str) -> str:
    """The environment's name without namespace and version."""
    return env_id.rpartition("/")[2].rpartition("-v")[0]


def full_id(env_id: str) -> str:
    """The registered id of ``env_id``, with or without ``wavegym/``; ``package:id`` imports the package first.

    An id without a version is that of the latest one.

    Raises:
        InputError: there is none; the nearest is named, or the way to an id of another package.
    """
    package, colon, rest = env_id.rpartition(":")
    if colon:
        import_package(package)
    wanted, known = rest if "/" in rest else NAMESPACE + rest, list_envs()
    if not colon and not nearest(wanted.partition("/")[0], {id.partition("/")[0] for id in known}):
        raise InputError(f"environment is {wanted!r}, expected PACKAGE:{wanted}, with the package that registers it")
    versions = [id for id in known if id.rpartition("-v")[0] == wanted]
    latest = max(versions, key=lambda id: int(id.rpartition("-v")[2]), default=wanted)
    return check_choice("environment", latest, known)
