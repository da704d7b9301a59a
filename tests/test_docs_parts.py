"""The examples on the docs' page about the parts run and print what the page shows."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import gymnasium as gym
import pytest

PAGE = Path(__file__).parents[1] / "docs" / "how_to" / "parts.md"
RECIPE = re.compile(r">>> import gymnasium.*?(?=>>> int\(loop)", re.DOTALL)


@pytest.mark.slow
def test_the_examples_hold():
    result = doctest.testfile(str(PAGE), module_relative=False)
    assert result.attempted > 15
    assert result.failed == 0


@pytest.mark.parametrize("name", ["KershawEvansPosition", "SectorSetup", "CameraSlew", "AgileClutter", "Urban"])
def test_the_recipe_for_a_scheduler_holds_in_every_kind_of_system(name):
    recipe = RECIPE.search(PAGE.read_text())[0].replace("SectorSetup", name)
    example = ">>> import numpy as np\n" + recipe + ">>> print(ended)\nTrue\n"
    test = doctest.DocTestParser().get_doctest(example, {}, name, str(PAGE), 0)
    assert doctest.DocTestRunner().run(test).failed == 0
    assert f"wavegym/{name}-v0" in gym.registry
