"""Objects by their place, and systems from their class, their place or another system."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Iterable
from typing import Any

from wavegym.core.errors import InputError
from wavegym.core.parameters import make_checked
from wavegym.core.system import System


def load_object(what: str, place: str) -> Any:
    """The object at ``"package.module:name"``.

    Args:
        what: the object's part, for an error, such as ``"system"``.
        place: where it is.

    Raises:
        InputError: no such module or name.
    """
    module, _, name = place.partition(":")
    if not name:
        raise InputError(f"{what} is {place!r}, expected 'package.module:Class'")
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise InputError(f"{what} is {place!r}, which cannot be loaded: {error}") from None


def build_system(system: System | type[System] | str, parameters: dict[str, Any], beside: Iterable[str] = ()) -> System:
    """A system with these parameters, built from its class, ``"package.module:Class"`` or another system.

    Args:
        system: what to build.
        parameters: by name.
        beside: other names that are valid in the same place; the error may suggest one of them.

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
    made: System = make_checked(kind, parameters, beside=beside)
    made.truth_model  # noqa: B018  (an invalid truth is reported here)
    return made
