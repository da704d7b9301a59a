"""Validated sets of parameters (dataclasses, ours are pydantic's), with errors a user can act on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from typing import Any, TypeVar

from pydantic import ValidationError

from wavegym.core.errors import InputError, nearest

Made = TypeVar("Made")


def make_checked(
    make: Callable[..., Made], values: Mapping[str, Any], source: str = "", beside: Iterable[str] = ()
) -> Made:
    """``make(**values)``.

    Args:
        make: a dataclass, or anything callable.
        values: parameters by name.
        source: where one that is missing is expected, e.g. ``" in the settings file"``.
        beside: names that are given in the same place and are not ``make``'s: to them an unknown one may be nearest.

    Raises:
        InputError: an unknown parameter (nearest named), one that is missing, or a value out of range.
    """
    title = getattr(make, "__name__", str(make))
    if dataclasses.is_dataclass(make):
        names = [field.name for field in dataclasses.fields(make)]
        for name in values:
            if name not in names:
                raise InputError(f"setting {name!r} is unknown to {title}{nearest(name, [*names, *beside])}")
    try:
        return make(**values)
    except ValidationError as error:
        raise _in_one_line(error, title, source) from None


def in_one_line(made: type[Made]) -> type[Made]:
    """A pydantic dataclass that users make themselves: what is wrong with its values is an InputError."""
    make: Callable[..., None] = made.__init__

    @wraps(make)
    def checked(self: Made, *values: Any, **named: Any) -> None:
        try:
            make(self, *values, **named)
        except ValidationError as error:
            raise _in_one_line(error, made.__name__, "") from None

    made.__init__ = checked  # type: ignore
    return made


def _in_one_line(error: ValidationError, title: str, source: str) -> InputError:
    """The first of pydantic's complaints: which value, and what was expected."""
    complaints = error.errors()
    first = complaints[0]
    own, where, given = first.get("ctx", {}).get("error"), first["loc"], first["input"]
    if isinstance(own, InputError):  # raised by the class itself, and complete
        return own
    name = ".".join(map(str, where)) or title
    if first["type"] == "missing":
        if not isinstance(where[-1], int):
            return InputError(f"setting {name!r} is missing, expected it{source or f' for {title}'}")
        # of a tuple; each element that lacks is a complaint
        name = ".".join(map(str, where[:-1]))
        lacking = sum(each["type"] == "missing" and each["loc"][:-1] == where[:-1] for each in complaints)
        return InputError(f"{name} is {given!r}, expected {where[-1] + lacking} elements, not {where[-1]}")
    if first["type"] == "too_long":
        context = first["ctx"]
        wanted = f"{context['max_length']} elements, not {context['actual_length'] or 'more'}"
        return InputError(f"{name} is {given!r}, expected {wanted}")
    return InputError(f"{name} is {given!r}: {first['msg']}")
