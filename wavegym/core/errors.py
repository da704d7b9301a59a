"""Errors a user can act on: one line that names the value, what was expected and the nearest valid choice."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable
from numbers import Real
from typing import Any


class InputError(ValueError):
    """A user's mistake. The message is one line; command lines print it without a traceback."""


class UnexpectedKeywordError(InputError, TypeError):
    """A keyword that nobody takes: a user's mistake, and the TypeError that Python raises for one.

    Some libraries try keywords and expect "unexpected keyword argument 'name'" in the message. Gymnasium's
    ``make`` raises a TypeError of the environment again and appends all arguments; this error omits them.
    """

    def __init__(self, message: str) -> None:
        super().__init__(message.partition(" was raised from the environment creator for ")[0])


class WrongTypeError(InputError, TypeError):
    """A value of a type that cannot be meant: a user's mistake, and the TypeError that Gymnasium raises for one."""


class InputWarning(UserWarning):
    """Something about the input that a user should know but may have intended. The message is one line."""


def nearest(value: object, choices: Iterable[str]) -> str:
    """``"; did you mean 'x'?"`` for the choice closest to ``value``, or ``""`` where none is close."""
    close = difflib.get_close_matches(str(value), list(choices), n=1, cutoff=0.4)
    return f"; did you mean {close[0]!r}?" if close else ""


def check_choice(name: str, value: object, choices: Iterable[str]) -> str:
    """Return ``value`` if it is one of ``choices``; otherwise raise an InputError naming the nearest one."""
    allowed = list(choices)
    if isinstance(value, str) and value in allowed:
        return value
    listed = ", ".join(repr(c) for c in allowed)
    raise InputError(f"{name} is {value!r}, expected one of {listed}{nearest(value, allowed)}")


def check_positive(name: str, value: float, unit: str = "") -> float:
    """Return ``value`` if it is finite and > 0; otherwise raise an InputError."""
    return _checked(name, value, unit, lambda number: number > 0 and math.isfinite(number), "a finite number > 0")


def check_non_negative(name: str, value: float, unit: str = "") -> float:
    """Return ``value`` if it is finite and >= 0; otherwise raise an InputError."""
    return _checked(name, value, unit, lambda number: number >= 0 and math.isfinite(number), "a finite number >= 0")


def check_within(name: str, value: float, low: float, high: float, unit: str = "") -> float:
    """Return ``value`` if low <= value <= high; otherwise raise an InputError naming the nearest bound."""
    wanted = f"a number in [{low:g}, {high:g}]"
    if _is_number(value) and math.isfinite(value):
        wanted += f" (nearest: {min(max(value, low), high):g})"
    return _checked(name, value, unit, lambda number: low <= number <= high, wanted)


def check_probability(name: str, value: float) -> float:
    """Return ``value`` if 0 < value < 1; otherwise raise an InputError."""
    return _checked(name, value, "", lambda number: 0.0 < number < 1.0, "a probability above 0 and below 1")


def check_int(name: str, value: Any, low: int) -> int:
    """Return ``value`` as an int if it is an integer >= low; otherwise raise an InputError naming the nearest."""
    if isinstance(value, bool) or not hasattr(value, "__index__") or int(value) < low:
        close = max(low, round(value)) if _is_number(value) and math.isfinite(value) else low
        raise InputError(f"{name} is {value!r}, expected an integer >= {low} (nearest: {close})")
    return int(value)


def check_ordered(name: str, low: float, high: float) -> None:
    """Raise an InputError unless low <= high."""
    if not (math.isfinite(low) and math.isfinite(high)):
        raise InputError(f"{name} is ({low:g}, {high:g}), expected finite numbers")
    if not low <= high:
        raise InputError(f"{name} is ({low:g}, {high:g}), expected (low, high); nearest: ({high:g}, {low:g})")


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _checked(name: str, value: float, unit: str, valid: Callable[[float], bool], wanted: str) -> float:
    if not (_is_number(value) and valid(value)):
        raise InputError(f"{name} is {value!r}{' ' + unit if unit else ''}, expected {wanted}")
    return value
