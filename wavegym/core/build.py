"""Build a system from its class, its place or another system, and parameters."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

from wavegym.core.loading import load_object
from wavegym.core.parameters import make_checked
from wavegym.core.system import System


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
