"""Objects by their place: ``"package.module:name"``."""

from __future__ import annotations

import importlib
from typing import Any

from wavegym.core.errors import InputError


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
