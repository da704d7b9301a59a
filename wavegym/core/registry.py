"""Parts by name: of this package, of other packages, of entry points; and any object by its place."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar

from wavegym.core.errors import InputError, check_choice

Part = TypeVar("Part")
NAME = re.compile(r"[A-Za-z][\w.-]*")  # ':', '@', ',' and '/' separate names from arguments, bases and folders


def check_callable(name: str, part: Any) -> None:
    """Raise an InputError unless ``part`` can be called: what most registries hold."""
    if not callable(part):
        raise InputError(f"{name!r} is registered as {part!r}, expected something callable")


class Registry(Generic[Part]):
    """Parts of one kind by name.

    Args:
        kind: a noun such as "chirp law". The entry points of other packages are in the group ``wavegym.chirp_laws``.
        own: the parts of this package.
        check: called with the name and the part of another package; raises an InputError for an unfit part.
    """

    def __init__(self, kind: str, own: Mapping[str, Part], check: Callable[[str, Any], None] = check_callable) -> None:
        self.kind, self.group = kind, f"wavegym.{kind.replace(' ', '_')}s"
        self.own, self.added = own, dict[str, Part]()
        self._check = check

    def register(self, name: str, part: Part) -> None:
        """Add a part.

        Raises:
            InputError: a taken or invalid name, or an unfit part.
        """
        if not isinstance(name, str) or not NAME.fullmatch(name):
            wanted = "a letter, then letters, digits, '-', '_' or '.'"
            raise InputError(f"name of a {self.kind} is {name!r}, expected {wanted}")
        if name in self.own or self.added.get(name, part) is not part:
            raise InputError(f"{self.kind} {name!r} is registered already, expected another name")
        self._check(name, part)
        self.added[name] = part

    def get(self, name: str) -> Part:
        """The part ``name``. Entry points are read only for a name that is not registered.

        Raises:
            InputError: no such part (nearest named), or the entry point fails to load.
        """
        if isinstance(name, str) and name in self.own:
            return self.own[name]
        if not isinstance(name, str) or name not in self.added:
            check_choice(self.kind, name, self.names())
            self.register(name, _loaded(self.kind, self._entry_points()[name]))
        return self.added[name]

    def names(self) -> tuple[str, ...]:
        """All names, this package's first."""
        return (*self.own, *self.added, *(name for name in self._entry_points() if name not in self.added))

    def __contains__(self, name: object) -> bool:
        return name in self.own or name in self.added or name in self._entry_points()

    def _entry_points(self) -> dict[str, EntryPoint]:
        return {point.name: point for point in entry_points(group=self.group) if point.name not in self.own}


def _loaded(kind: str, point: EntryPoint) -> Any:
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        raise InputError(f"{kind} {point.name!r} is at {point.value!r}, which cannot be loaded: {error}") from error


def import_package(name: str) -> None:
    """Import a package that registers environments or parts. Raises an InputError where that is impossible."""
    try:
        importlib.import_module(name)
    except (ImportError, ValueError) as error:  # ValueError: an empty name
        raise InputError(f"package is {name!r}, expected an importable one: {error}") from error


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
