"""Extreme parameters are refused when an environment is made, or they play: nothing fails in mid-episode.

Each numeric parameter of each environment is taken to its bounds and multiplied by -1, 0, and 1e-9 to 1e9,
one at a time.
"""

from __future__ import annotations

import dataclasses
import importlib
import math
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from wavegym.core.errors import InputError
from wavegym.core.parameters import make_checked
from wavegym.evaluation.play import make_task
from wavegym.registration import SYSTEMS

FACTORS = (1e9, 1e5, 1e-5, 1e-9)
STEPS = 5
VARIANTS: tuple[tuple[str, dict[str, Any]], ...] = (
    *((id, {}) for id in SYSTEMS),
    (
        "wavegym/KershawEvans-v0",
        {"model": "ca", "action": "box", "weights": (1.0, 1.0, 0.0), "prior_variance": (1e4, 1e4, 100.0)},
    ),
    ("wavegym/AgileClutter-v0", {"tracker": "particle", "particles": 20, "action": "box"}),
    ("wavegym/RfEo-v0", {"action": "joint", "penalty": "log-barrier", "first_estimate": "drawn"}),
)


def is_numeric(value: Any) -> bool:
    """Whether a parameter is a number, or a tuple of numbers of any depth."""
    if isinstance(value, tuple):
        return len(value) > 0 and all(map(is_numeric, value))
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def numbers(system: Any, but: Any = ()) -> list[str]:
    """Names of the numeric parameters of ``system``."""
    return [f.name for f in dataclasses.fields(system) if f.name not in but and is_numeric(getattr(system, f.name))]


def scaled(value: Any, factor: float) -> Any:
    """A number, or each number of a tuple, times ``factor``; an integer stays one."""
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    return int(value * factor) if isinstance(value, int) else value * factor


def spoilt(value: Any, by: float) -> Any:
    """A number, or the first number of a tuple, replaced."""
    return (spoilt(value[0], by), *value[1:]) if isinstance(value, tuple) else by


def bounds(system: type, name: str) -> Iterator[float]:
    """The closed bounds of a parameter, and values next to the open ones."""
    inside = {"ge": lambda b: b, "le": lambda b: b, "gt": lambda b: b + 1e-9, "lt": lambda b: b - 1e-12}
    for declared in system.__pydantic_fields__[name].metadata:  # type: ignore[attr-defined]
        for key, move in inside.items():
            if hasattr(declared, key):
                yield move(getattr(declared, key))


def extremes(system: Any, name: str) -> Iterator[Any]:
    """Extreme values of the parameter ``name``: scaled as a whole, at its bounds, and one element of a tuple scaled."""
    value = getattr(system, name)
    yield from (scaled(value, factor) for factor in (*FACTORS, 0.0, -1.0))
    if not isinstance(value, tuple):
        yield from (type(value)(bound) for bound in bounds(type(system), name))
        return
    for k in {0, len(value) - 1}:
        for factor in (FACTORS[0], FACTORS[-1]):
            yield (*value[:k], scaled(value[k], factor), *value[k + 1 :])


def played(id: str, parameters: dict[str, Any]) -> str:
    """What fails in the first steps of two random episodes, or ""; parameters refused by ``make_vec`` are fine."""
    try:
        envs = gym.make_vec(id, num_envs=2, **parameters)
    except InputError:
        return ""
    try:
        observations, info = envs.reset(seed=1)
        for k in range(STEPS):
            envs.action_space.seed(k)
            action = envs.action_space.sample()
            if "action_mask" in info and isinstance(envs.single_action_space, gym.spaces.Discrete):
                action = np.argmax(info["action_mask"] * np.random.default_rng(k).random(info["action_mask"].shape), 1)
            observations, rewards, _, _, info = envs.step(action)
            figures = {name: value for name, value in info.items() if getattr(value, "dtype", None) == np.float64}
            for name, value in {"observations": observations, "rewards": rewards, **figures}.items():
                if not np.isfinite(value).all():
                    return f"{name} are not finite at step {k}"
            if (info["cost"] < 0.0).any():
                return f"the cost is negative at step {k}"
    except Exception as error:  # whatever fails in mid-episode is the finding
        return f"{type(error).__name__}: {error}"
    return ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("id", "fixed"),
    VARIANTS,
    ids=lambda value: value if isinstance(value, str) else "+".join(value),
)
def test_an_extreme_value_is_refused_at_the_door_or_plays(id: str, fixed: dict[str, Any]) -> None:
    module, name = SYSTEMS[id].system.split(":")
    system = make_checked(getattr(importlib.import_module(module), name), fixed)
    names = numbers(system, fixed)
    assert len(names) > 10
    cases = [(name, value) for name in names for value in extremes(system, name)]
    failures = [(name, value, played(id, {**fixed, name: value})) for name, value in cases]
    found = [f"{name} = {value!r}: {failure}" for name, value, failure in failures if failure]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("id", SYSTEMS)
def test_a_number_that_is_none_is_refused_in_one_line(id: str, value: float) -> None:
    system = make_task(id, {}).system
    for name in numbers(system):
        with pytest.raises(InputError, match=f"^{name}") as caught:
            make_checked(type(system), {name: spoilt(getattr(system, name), value)})
        assert "\n" not in str(caught.value)
