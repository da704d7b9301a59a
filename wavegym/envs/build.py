"""From a name and parameters to a system, with errors a user can act on."""

from __future__ import annotations

import dataclasses
import importlib
from typing import Any

from pydantic import ValidationError

from wavegym.errors import InputError, nearest
from wavegym.systems.contract import System


def build_system(system: System | type[System] | str, parameters: dict[str, Any]) -> System:
    """The system itself, or one built from its class or ``"package.module:Class"`` and parameters.

    Raises:
        InputError: no such class, an unknown parameter (nearest named) or a value out of range.
    """
    if isinstance(system, System):
        if parameters:
            raise InputError(f"parameters {sorted(parameters)} were given beside a finished system, expected its class")
        return system
    make: Any = _load(system) if isinstance(system, str) else system
    names = [f.name for f in dataclasses.fields(make)] if dataclasses.is_dataclass(make) else None
    for name in parameters:
        if names is not None and name not in names:
            raise InputError(f"setting {name!r} is unknown to {make.__name__}{nearest(name, names)}")
    try:
        return make(**parameters)
    except ValidationError as error:
        first = error.errors()[0]
        own = first.get("ctx", {}).get("error")
        if isinstance(own, InputError):  # raised by the system itself, and complete
            raise own from None
        field = ".".join(str(part) for part in first["loc"]) or make.__name__
        raise InputError(f"{field} is {first['input']!r}: {first['msg']}") from None


def _load(path: str) -> Any:
    """The object at "package.module:name"."""
    module, _, name = path.partition(":")
    if not name:
        raise InputError(f"system is {path!r}, expected 'package.module:Class'")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise InputError(f"system is {path!r}, which cannot be loaded: {error}") from None
