"""Validation errors are one line that a user can act on."""

from __future__ import annotations

import dataclasses
import re
from typing import Literal

import gymnasium as gym
import pytest
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

import wavegym  # noqa: F401  (registers the environments)
from wavegym.core.errors import InputError, check_positive
from wavegym.core.parameters import (
    ParameterInfo,
    in_one_line,
    make_checked,
    parameter,
    parameter_infos,
    system_parameters,
)


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Radar:
    gain: float
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    corners: tuple[tuple[float, float], ...] = ()
    band: Literal["S", "X"] = "X"

    def __post_init__(self) -> None:
        check_positive("gain", self.gain)


@in_one_line
@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Sonar(Radar):
    """One that is made without ``make_checked``."""


def test_values_arrive_validated() -> None:
    assert make_checked(Radar, {"gain": 2, "corners": [[1, 2]]}) == Radar(gain=2.0, corners=((1.0, 2.0),))


def test_names_given_in_the_same_place_are_suggested_too() -> None:
    with pytest.raises(InputError, match="Radar got an unexpected keyword argument 'rewrd'; did you mean 'reward'"):
        make_checked(Radar, {"gain": 1.0, "rewrd": 2}, beside=["reward"])


def test_a_class_by_itself_says_the_same() -> None:
    with pytest.raises(InputError, match=r"place is .*, expected 3 elements, not 1"):
        Sonar(gain=1.0, place=(1.0,))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"gain is -1\.0, expected a finite number > 0"):
        Sonar(-1.0)
    assert Sonar(2.0) == Sonar(gain=2)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"gian": 2.0}, "Radar got an unexpected keyword argument 'gian'; did you mean 'gain'?"),
        ({}, "setting 'gain' is missing, expected it in the file"),
        ({"gain": -1.0}, "gain is -1.0, expected a finite number > 0"),
        ({"gain": "much"}, "gain is 'much': Input should be a valid number, unable to parse string as a number"),
        ({"gain": 1.0, "band": "Y"}, "band is 'Y', expected one of 'S', 'X'"),
        ({"gain": 1.0, "place": (1.0,)}, "place is (1.0,), expected 3 elements, not 1"),
        ({"gain": 1.0, "place": [1, 2, 3, 4]}, "place is [1, 2, 3, 4], expected 3 elements, not 4"),
        ({"gain": 1.0, "place": ()}, "place is (), expected 3 elements, not 0"),
        ({"gain": 1.0, "place": 5}, "place is 5, expected values in parentheses"),
        ({"gain": 1.0, "place": "a, b"}, "place is 'a, b', expected values in parentheses (nearest: ('a', 'b'))"),
        ({"gain": 1.0, "corners": ((1, 2), (3,), (4,))}, "corners.1 is (3,), expected 2 elements, not 1"),
        ({"gain": 1.0, "corners": ((1, 2, 3),)}, "corners.0 is (1, 2, 3), expected 2 elements, not 3"),
        ({"gain": 1.0, "corners": ((1, "b"),)}, "corners.0.1 is 'b': Input should be a valid number"),
    ],
)
def test_a_bad_value_is_named_in_one_line(values: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match="^" + re.escape(message)) as caught:
        make_checked(Radar, values, " in the file")
    assert "\n" not in str(caught.value)


def test_what_is_missing_is_expected_for_the_class_where_no_source_is_named() -> None:
    with pytest.raises(InputError, match=r"setting 'gain' is missing, expected it for Radar$"):
        make_checked(Radar, {})


def test_a_subclass_inherits_the_declarations_and_a_plain_dataclass_adds_its_own() -> None:
    @system_parameters
    class Base:
        q: float = parameter(1.0, "noise density", unit="m^2/s^3", ge=0)

    @dataclasses.dataclass(frozen=True)
    class Derived(Base):
        count: int = dataclasses.field(default=3, metadata={"description": "how many", "unit": "1"})
        name: str = ""

    declared = [ParameterInfo("q", "m^2/s^3", "noise density", False), ParameterInfo("count", "1", "how many", False)]
    assert parameter_infos(Derived) == [*declared, ParameterInfo("name", "", "", False)]
    assert parameter_infos(Base) == declared[:1]


def test_an_unknown_keyword_is_a_type_error_too_and_no_other_mistake_is() -> None:
    """TorchRL tries keywords with ``gym.make`` and continues after a TypeError with these words."""
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'") as caught:
        gym.make("wavegym/KershawEvans-v0", frameskip=1)
    assert isinstance(caught.value, InputError)
    assert str(caught.value).endswith("'frameskip'; did you mean 'forecasts'?")  # and nothing of Gymnasium's
    with pytest.raises(InputError) as wrong:
        gym.make("wavegym/KershawEvans-v0", dt=-1.0)
    assert not isinstance(wrong.value, TypeError)
