"""Validated sets of parameters (pydantic dataclasses) with one-line errors.

A field declares its default, meaning, unit and bounds in one place::

    @system_parameters
    class MySystem(System):
        q: float = parameter(1.0, "process noise density", unit="m^2/s^3", ge=0)

``describe`` and the pages of the docs read the same declaration.
"""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from copy import copy
from functools import wraps
from typing import Annotated, Any, NamedTuple, TypeVar, dataclass_transform

from pydantic import ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass
from pydantic.fields import FieldInfo

from wavegym.core.errors import InputError, UnexpectedKeywordError, nearest

Made = TypeVar("Made")

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Probability = Annotated[float, Field(gt=0, lt=1)]  # neither impossible nor certain
Count = Annotated[int, Field(ge=1)]
Interval = tuple[float, float]  # least and greatest


def parameter(default: Any, description: str, *, unit: str = "1", truth: bool = False, **bounds: Any) -> Any:
    """A field of a parameter set, with its meaning, unit and bounds.

    Args:
        default: the default value.
        description: the meaning; one line of the parameter table on the environment's page.
        unit: such as ``"s"``; ``"1"`` for a pure number, ``""`` for a value that is not a number.
        truth: whether its value in the world may differ from the tracker's assumption (``System.truth``).
        **bounds: as pydantic's ``Field`` takes them: ``gt``, ``ge``, ``lt``, ``le``, ``min_length``, ...
    """
    return Field(default, description=description, json_schema_extra={"unit": unit, "truth": truth}, **bounds)


def changed_default(base: type, name: str, default: Any) -> Any:
    """The field ``name`` of a base class with another default and the same meaning, unit and bounds."""
    field = copy(base.__pydantic_fields__[name])  # type: ignore[attr-defined]
    field.default = default
    return field


@dataclass_transform(frozen_default=True)
def system_parameters(cls: type[Made]) -> type[Made]:
    """Make a class a frozen dataclass of parameters that refuses unknown names and numbers that are not finite.

    The ``Field`` of a parameter moves from its default into its annotation. The default is then a plain value, and a
    subclass may be any kind of dataclass.
    """
    known = {**vars(sys.modules[cls.__module__]), **sys._getframe(1).f_locals}
    for name, field in list(vars(cls).items()):
        if isinstance(field, FieldInfo):
            annotation = cls.__annotations__[name]
            evaluated = eval(annotation, known) if isinstance(annotation, str) else annotation
            cls.__annotations__[name] = Annotated[evaluated, field]
            setattr(cls, name, field.default)
    closed = ConfigDict(extra="forbid", arbitrary_types_allowed=True, allow_inf_nan=False)
    return dataclass(frozen=True, config=closed)(cls)  # type: ignore[return-value]


class ParameterInfo(NamedTuple):
    """The declaration of one parameter."""

    name: str
    unit: str
    description: str
    truth: bool  # whether its value in the world may differ from the tracker's assumption


def parameter_infos(made: type) -> list[ParameterInfo]:
    """The parameters of a dataclass; a plain one states them by ``metadata={"description": ..., "unit": ...}``."""
    stated = getattr(made, "__pydantic_fields__", {})
    infos = []
    for field in dataclasses.fields(made):
        about: Mapping[str, Any] = field.metadata
        if field.name in stated:
            declared = stated[field.name]
            about = {"description": declared.description or "", **(declared.json_schema_extra or {})}
        unit, description = (str(about.get(key, "")) for key in ("unit", "description"))
        infos.append(ParameterInfo(field.name, unit, description, bool(about.get("truth", False))))
    return infos


def make_checked(
    make: Callable[..., Made], values: Mapping[str, Any], source: str = "", beside: Iterable[str] = ()
) -> Made:
    """``make(**values)``.

    Args:
        make: a dataclass, or anything callable.
        values: parameters by name.
        source: where a missing parameter is expected, for the error, e.g. ``" in the settings file"``.
        beside: other names that are valid in the same place; the error may suggest one of them.

    Raises:
        InputError: a missing parameter, or a value out of range.
        UnexpectedKeywordError: an unknown parameter (nearest named).
    """
    title = getattr(make, "__name__", str(make))
    if dataclasses.is_dataclass(make):
        names = [field.name for field in dataclasses.fields(make)]
        for name in values:
            if name not in names:
                if name in beside:
                    raise UnexpectedKeywordError(f"{name} is no parameter of {title}, expected it in gym.make only")
                unexpected = f"{title} got an unexpected keyword argument {name!r}"
                raise UnexpectedKeywordError(f"{unexpected}{nearest(name, [*names, *beside])}")
    try:
        return make(**values)
    except ValidationError as error:
        raise _in_one_line(error, make, source) from None


def in_one_line(made: type[Made]) -> type[Made]:
    """Decorate a pydantic dataclass that users construct directly: its validation errors become InputErrors."""
    make: Callable[..., None] = made.__init__

    @wraps(make)
    def checked(self: Made, *values: Any, **named: Any) -> None:
        try:
            make(self, *values, **named)
        except ValidationError as error:
            raise _in_one_line(error, made, "") from None

    made.__init__ = checked  # type: ignore
    return made


def _in_one_line(error: ValidationError, made: Any, source: str) -> InputError:
    """The first of pydantic's errors as one line: the value, and the valid values."""
    errors, title = error.errors(), getattr(made, "__name__", str(made))
    first = errors[0]
    own, where, given = first.get("ctx", {}).get("error"), first["loc"], first["input"]
    if isinstance(own, InputError):  # raised by a check of the class itself, and complete
        return own
    name = ".".join(map(str, where)) or title
    if first["type"] == "missing":
        if not isinstance(where[-1], int):
            return InputError(f"setting {name!r} is missing, expected it{source or f' for {title}'}")
        # A tuple that is too short: one error for each missing element.
        name = ".".join(map(str, where[:-1]))
        missing = sum(each["type"] == "missing" and each["loc"][:-1] == where[:-1] for each in errors)
        return InputError(f"{name} is {given!r}, expected {where[-1] + missing} elements, not {where[-1]}")
    if first["type"] == "too_long":
        context = first["ctx"]
        wanted = f"{context['max_length']} elements, not {context['actual_length'] or 'more'}"
        return InputError(f"{name} is {given!r}, expected {wanted}")
    unit = _unit(made, where[0]) if where and isinstance(given, (int, float)) else ""
    return InputError(f"{name} is {given!r}{unit}{_expected(made, first)}")


def _unit(made: Any, name: Any) -> str:
    """The unit of the field ``name`` after a space, or "" without a unit."""
    stated = getattr(made, "__pydantic_fields__", {}).get(name)
    unit = (stated.json_schema_extra or {}).get("unit", "") if stated else ""
    return f" {unit}" if unit != "1" and unit and "," not in unit else ""


BOUNDS = {  # pydantic's type of error: key of the bound, and the valid values
    "greater_than": ("gt", "{1} > {0:g}"),
    "greater_than_equal": ("ge", "{1} >= {0:g} (nearest: {0:g})"),
    "less_than": ("lt", "{1} < {0:g} (nearest: just below it)"),
    "less_than_equal": ("le", "{1} <= {0:g} (nearest: {0:g})"),
}


def _expected(made: Any, error: Any) -> str:
    """The valid values, as the part of the message after ``name is value``."""
    kind, context = error["type"], error.get("ctx", {})
    if kind in BOUNDS:
        key, wanted = BOUNDS[kind]
        kind_of = "an integer" if type(context[key]) is int else "a finite number"
        return f", expected {wanted.format(context[key], kind_of)}"
    if kind == "finite_number":
        return f", expected a finite number{_bound(made, error['loc'][0])}"
    if kind == "literal_error":
        choices = re.findall(r"'([^']*)'", context["expected"])
        return f", expected one of {', '.join(map(repr, choices))}{nearest(error['input'], choices)}"
    if kind == "tuple_type":
        given = error["input"]
        names = tuple(part.strip() for part in given.split(",")) if isinstance(given, str) else ()
        return f", expected values in parentheses{f' (nearest: {names!r})' if names else ''}"
    return f": {error['msg']}"


def _bound(made: Any, name: Any) -> str:
    """`` > 0`` for a field with that lower bound, or "" without one."""
    stated = getattr(made, "__pydantic_fields__", {}).get(name)
    for bound in stated.metadata if stated else ():
        for key, sign in (("gt", ">"), ("ge", ">=")):
            if hasattr(bound, key):
                return f" {sign} {getattr(bound, key):g}"
    return ""
