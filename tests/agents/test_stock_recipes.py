"""What a stock learner reaches: each recipe trains once, and the page has a line for it."""

from __future__ import annotations

import json

import pytest

from agents import stock_recipes
from agents.leaderboard import ROOT
from wavegym.core.errors import InputError


@pytest.mark.slow
def test_each_recipe_is_trained_and_compared(tmp_path, monkeypatch):
    for name, value in {
        "FOLDER": tmp_path,
        "PAGE": tmp_path / "page.md",
        "WORLDS": 3,
        "NAMES": ("SectorSetup",),
    }.items():
        monkeypatch.setattr(stock_recipes, name, value)
    for recipe, (template, settings, _) in stock_recipes.RECIPES.items():
        monkeypatch.setitem(stock_recipes.RECIPES, recipe, (template, settings, 2048))
    stock_recipes.PAGE.write_text(f"{stock_recipes.START}\n{stock_recipes.END}\n")
    stock_recipes.main([])
    found = json.loads((tmp_path / "SectorSetup.json").read_text())
    assert list(found) == list(stock_recipes.RECIPES)
    first, second = (found[recipe]["myopic"]["percent"] for recipe in list(found)[:2])
    assert first != second  # the reward reached the learner
    lines = stock_recipes.PAGE.read_text().splitlines()
    assert [line.split("|")[2].strip() for line in lines[4:9]] == list(stock_recipes.RECIPES)
    section = stock_recipes.section("wavegym/SectorSetup-v0")
    assert section.count("```python") == len(stock_recipes.HEADINGS) == 3
    assert all(stock_recipes.code(recipe, "wavegym/SectorSetup-v0") in section for recipe in stock_recipes.HEADINGS)


def test_an_environment_without_results_has_no_section(tmp_path, monkeypatch):
    monkeypatch.setattr(stock_recipes, "FOLDER", tmp_path)
    assert stock_recipes.section("wavegym/SectorSetup-v0") == ""


def test_an_unknown_recipe_is_refused():
    with pytest.raises(InputError, match="recipe is 'scorer', expected one of"):
        stock_recipes.main(["CameraSlew", "--recipes", "scorer"])


def test_an_unknown_environment_is_refused():
    with pytest.raises(InputError, match="did you mean 'CameraSlew'"):
        stock_recipes.main(["CameraSlw"])


def test_the_page_is_that_of_the_results_on_file():
    results = {
        name: json.loads(file.read_text())
        for name in stock_recipes.NAMES
        if (file := stock_recipes.FOLDER / f"{name}.json").exists()
    }
    page = (ROOT / "docs" / "how_to" / "train_with_sb3.md").read_text()
    assert stock_recipes.table(results) in page
