"""Scenario files: the parameters of an environment in TOML.

``gym.make(id, scenario="file.toml")`` reads one, ``wavegym describe ID --toml`` writes one. A key is a parameter of the
system, a setting of the environment, or ``id``; the table ``[truth]`` is the parameter ``truth``. Parameters are
checked where all parameters are: in ``wavegym.core.system.build_system``.
"""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, get_args

import gymnasium as gym

from wavegym.core.errors import InputError, nearest
from wavegym.core.files import read_toml, toml_key, toml_value
from wavegym.core.parameters import ParameterInfo, parameter_infos
from wavegym.core.registry import load_object
from wavegym.core.system import System, build_system
from wavegym.registration import SETTINGS, SHELL, full_id, registered_system

ID, TRUTH = "id", "truth"
# That a scenario may state, with the defaults.
OWN_SETTINGS = {
    "reward": "cost",
    "forecasts": False,
    "candidates": None,
    "measurements": False,
    "observation": "belief",
}
WIDTH = 100  # of comments


class Scenario(NamedTuple):
    """The content of a scenario file."""

    id: str | None  # full id of the environment that the file is for
    parameters: dict[str, Any]  # of the system, and settings of the environment


def read_scenario(file: Path | str) -> Scenario:
    """The content of a scenario file; arrays become tuples, and an empty ``[truth]`` is no truth.

    Raises:
        InputError: the file cannot be read, is no TOML, or names no known environment.
    """
    content = {name: _tuples(value) for name, value in read_toml("scenario", file).items()}
    env_id = content.pop(ID, None)
    if content.get(TRUTH) == {}:
        del content[TRUTH]
    if env_id is not None and not isinstance(env_id, str):
        raise InputError(f"scenario {str(file)!r}: id is {env_id!r}, expected a string")
    return Scenario(None if env_id is None else full_id(env_id), content)


def scenario_parameters(file: Path | str, system: Any) -> dict[str, Any]:
    """The parameters in a scenario file for ``system``: a System, its class or ``"package.module:Class"``.

    A relative path among them starts at the file's folder.

    Raises:
        InputError: the file cannot be read, is for another system, or has an unknown key (nearest named).
    """
    env_id, parameters = read_scenario(file)
    kind: Any = _kind(system)
    if env_id is not None and _kind(registered_system(env_id)[0]) is not kind:
        raise InputError(f"scenario {str(file)!r} is for {env_id}, expected one for {kind.__name__}")
    names = [field.name for field in dataclasses.fields(kind) if field.init]
    for name, value in parameters.items():
        if name in SETTINGS and name not in (*names, *OWN_SETTINGS):
            raise InputError(f"scenario {str(file)!r} has {name!r}, expected it in gym.make or gym.make_vec")
        if name not in (*names, *OWN_SETTINGS):
            known = [*names, *OWN_SETTINGS, ID]
            raise InputError(f"scenario {str(file)!r}: {kind.__name__} has no {name!r}{nearest(name, known)}")
        if isinstance(value, str) and _is_path(kind, name):
            parameters[name] = str(Path(file).parent / value)
    return parameters


def with_scenario(system: Any, registered: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """All parameters: those of the registration, then those of the file ``given["scenario"]``, then those given.

    Raises:
        InputError: see ``scenario_parameters``.
    """
    file = {**registered, **given}.get("scenario")
    stated = scenario_parameters(file, system) if file else {}
    merged = {**registered, **stated, **given}
    merged.pop("scenario", None)
    return merged


def scenario_differences(env_id: str, file: Path | str) -> dict[str, Any]:
    """The parameters of the system in a scenario file that differ from those of the environment ``env_id``.

    Raises:
        InputError: see ``scenario_parameters``; a value out of range.
    """
    system, registered = registered_system(env_id)
    own = {name: value for name, value in registered.items() if name not in SHELL}
    stated = {name: value for name, value in scenario_parameters(file, system).items() if name not in OWN_SETTINGS}
    usual, changed = (build_system(system, each, SETTINGS) for each in (own, {**own, **stated}))
    return {name: value for name, value in stated.items() if repr(getattr(usual, name)) != repr(getattr(changed, name))}


def scenario_toml(id: str, /, **parameters: Any) -> str:
    """The environment ``gym.make(id, **parameters)`` as a scenario file: every parameter, its unit and its meaning.

    A setting of the environment that is not given, and a parameter that is None, stand in a comment.

    Raises:
        InputError: no such environment or parameter (nearest named), a value out of range, or one that TOML lacks.
    """
    id = full_id(id)
    system: Any = gym.make(id, **parameters).unwrapped.system  # type: ignore[attr-defined]
    default: Any = gym.make(id).unwrapped.system  # type: ignore[attr-defined]
    file = parameters.pop("scenario", None)
    stated = {**(scenario_parameters(file, system) if file else {}), **parameters}
    lines = [
        f"# A scenario of {id}: a key that is left out keeps its default.",
        f'# gym.make("{id}", scenario="FILE.toml"), or wavegym evaluate FILE.toml',
        f"{ID} = {toml_value(id)}",
        "",
        "# Settings of the environment",
    ]
    for name, value in OWN_SETTINGS.items():
        lines += ["", *_comment(SETTINGS[name]), _entry(name, stated.get(name, value), comment=name not in stated)]
    infos = [info for info in parameter_infos(type(system)) if info.name != TRUTH]
    lines += ["", "# Parameters of the system"]
    for info in infos:
        value, usual = getattr(system, info.name), getattr(default, info.name)
        lines += ["", *_comment(_meaning(info, value, usual)), _parameter(info.name, value, usual)]
    if any(info.truth for info in infos):
        lines += ["", *_truth([info.name for info in infos if info.truth], system)]
    return "\n".join(lines) + "\n"


def _truth(names: list[str], system: Any) -> list[str]:
    """The table of parameters in which the world may differ."""
    world = system.truth or {}
    about = "Parameters in which the world differs from what the tracker and the schedulers assume (above)"
    entries = [_entry(name, world.get(name, getattr(system, name)), comment=name not in world) for name in names]
    return [*_comment(about), f"[{TRUTH}]", *entries]


def _meaning(info: ParameterInfo, value: Any, usual: Any) -> str:
    unit = "" if info.unit in ("", "1") else f" [{info.unit}]"
    changed = "" if repr(value) == repr(usual) else f"; default: {usual if usual is None else toml_value(usual)}"
    return f"{info.description}{unit}{changed}"


def _parameter(name: str, value: Any, usual: Any) -> str:
    """The line of one parameter; None, which TOML lacks, is a comment."""
    if value is None and usual is not None:
        raise InputError(f"{name} is None, expected a value: TOML has no None, and the default is {usual!r}")
    return _entry(name, value.absolute() if isinstance(value, Path) else value, comment=value is None)


def _entry(name: str, value: Any, comment: bool) -> str:
    try:
        text = "(none)" if value is None else toml_value(value)
    except InputError as error:
        raise InputError(f"{name} cannot be written: {error}") from None
    return f"{'# ' if comment else ''}{toml_key(name)} = {text}"


def _comment(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False)


def _kind(system: Any) -> Any:
    """The class of a system, which may be given by its place."""
    if isinstance(system, str):
        return load_object("system", system)
    return type(system) if isinstance(system, System) else system


def _is_path(kind: type, name: str) -> bool:
    """Whether the parameter ``name`` is declared as a path."""
    declared = getattr(kind, "__pydantic_fields__", {}).get(name)
    return declared is not None and Path in (declared.annotation, *get_args(declared.annotation))


def _tuples(value: Any) -> Any:
    """TOML's arrays as tuples, which parameters are."""
    if isinstance(value, dict):
        return {key: _tuples(entry) for key, entry in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
