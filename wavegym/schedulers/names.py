"""Schedulers by the names that command lines and summaries use."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from wavegym.errors import InputError, choice
from wavegym.schedulers.closed_form import MyopicClosedForm
from wavegym.schedulers.lookahead import Lookahead
from wavegym.schedulers.myopic import Myopic
from wavegym.schedulers.optimum import Optimum
from wavegym.schedulers.policy import Policy
from wavegym.schedulers.progressive import Progressive
from wavegym.schedulers.simple import Fixed, RandomChoice, RoundRobin
from wavegym.schedulers.tuning import best_fixed
from wavegym.systems.contract import System


def make_policy(name: str, system: System, tuning_worlds: Any) -> Policy:
    """The scheduler called ``name``.

    Args:
        name: ``random``, ``round-robin``, ``fixed:K`` (the constant K), ``best-fixed`` (found on ``tuning_worlds``),
            ``myopic``, ``myopic:exhaustive`` (without the system's own search), ``myopic:determinant``,
            ``myopic:gate``, ``myopic:closed-form`` or ``myopic:progressive`` (for action="box", with Gaussian or
            generalised chirps), ``lookahead:H`` (steps; up to a million sequences), or ``optimum`` (clairvoyant).
        system: what it is to schedule.
        tuning_worlds: tapes, axis 0 = world, that are not those of the test.

    Raises:
        InputError: an unknown name (nearest named), a K or H that is not an integer in range, or a scheduler that this
            system cannot have.
    """
    family, _, argument = name.partition(":")
    if family in NUMBERED:
        return NUMBERED[family](_integer(name, family, argument))
    return PLAIN[choice("policy", name, FORMS)](system, tuning_worlds)


def is_scheduler(name: str) -> bool:
    """Whether ``name`` is a scheduler's rather than, say, a folder's."""
    return name in PLAIN or name.partition(":")[0] in NUMBERED


def _integer(name: str, family: str, argument: str) -> int:
    if not re.fullmatch(r"-?\d+", argument):
        number = float(argument) if re.fullmatch(r"-?\d*\.?\d+", argument) else 2
        wanted = f"{family}: and an integer (nearest: '{family}:{round(number)}')"
        raise InputError(f"policy is {name!r}, expected {wanted}")
    return int(argument)


def _determinant(system: System, worlds: Any) -> Policy:
    if not hasattr(system.begin(worlds).public, "covariance"):
        raise _impossible("myopic:determinant", system, "its belief has no single covariance")
    return Myopic("determinant")


def _gate(system: System, worlds: Any) -> Policy:
    if not hasattr(system, "innovation_covariance"):
        raise _impossible("myopic:gate", system, "it has no innovation_covariance")
    return Myopic("gate")


def _impossible(name: str, system: System, why: str) -> InputError:
    return InputError(f"policy {name!r} cannot be computed for {type(system).__name__}: {why}; nearest: 'myopic'")


NUMBERED: dict[str, Callable[[int], Policy]] = {"fixed": Fixed, "lookahead": Lookahead}
PLAIN: dict[str, Callable[[System, Any], Policy]] = {
    "random": lambda system, worlds: RandomChoice(),
    "round-robin": lambda system, worlds: RoundRobin(),
    "best-fixed": lambda system, worlds: Fixed(best_fixed(system, worlds)),
    "myopic": lambda system, worlds: Myopic(),
    "myopic:exhaustive": lambda system, worlds: Myopic(fused=False),
    "myopic:determinant": _determinant,
    "myopic:gate": _gate,
    "myopic:closed-form": lambda system, worlds: MyopicClosedForm(),
    "myopic:progressive": lambda system, worlds: Progressive(),
    "optimum": lambda system, worlds: Optimum(),
}
FORMS = (*PLAIN, "fixed:K", "lookahead:H")
