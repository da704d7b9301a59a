"""The committed pages of the environments are up to date, and begin with what a reader looks for."""

from __future__ import annotations

import re
import sys

import pytest

from research import pages as module
from research.benchmarks.steps import read
from research.pages import FOLDER, main, page
from wavegym.envs.describe import describe
from wavegym.evaluation.play import make_task
from wavegym.registration import SYSTEMS
from wavegym.schedulers.tuned_constants import recorded


@pytest.mark.slow
def test_the_committed_pages_are_what_the_command_writes(tmp_path, monkeypatch):
    """One for every environment and one for all; make them again with make docs."""
    made = tmp_path / "new" / "folder"
    how_to = ("compare_policies.md", "train_with_other_libraries.md")
    partly = [module.README, *(module.HOW_TO / name for name in how_to)]
    for file in partly:
        begun, _, rest = file.read_text(encoding="utf-8").partition(module.START)
        (tmp_path / file.name).write_text(f"{begun}{module.START}{module.END}{rest.partition(module.END)[2]}", "utf-8")
    for name, place in {"FOLDER": made, "README": tmp_path / "README.md", "HOW_TO": tmp_path}.items():
        monkeypatch.setattr(module, name, place)
    monkeypatch.setattr(sys, "argv", ["pages"])
    main()
    written, committed = (
        {path.name: path.read_text(encoding="utf-8") for path in folder.glob("*.md")} for folder in (made, FOLDER)
    )
    assert set(written) == {"index.md", *(f"{env_id.partition('/')[2]}.md" for env_id in SYSTEMS)}
    assert [name for name in sorted(written | committed) if written.get(name) != committed.get(name)] == []
    for file in partly:
        assert (tmp_path / file.name).read_text(encoding="utf-8") == file.read_text(encoding="utf-8"), file.name


def test_a_page_begins_with_picture_and_best_scores(monkeypatch):
    monkeypatch.setattr(module, "read_speeds", list)
    text = page("wavegym/SectorSetup-v0")
    picture, best, table = text.split("\n\n", 5)[2:5]
    assert picture == "![an episode, step by step](../images/SectorSetup.webp)"
    known = recorded(make_task("wavegym/SectorSetup-v0", {}).system)
    against = f"Policies against the best heuristic, `{known['best-simple']}`"
    assert best.startswith(f"Best known: `{known['best-planner']}`. {against}")
    costs = [float(row.split("|")[2]) for row in table.splitlines()[2:]]
    assert len(costs) == 6
    assert costs == sorted(costs)
    described, _, recipes = text.replace("\n\n".join([picture, best, table, ""]), "").partition("\n\n\n## Train it")
    assert described + "\n" == describe("wavegym/SectorSetup-v0")
    timed = [line for line in recipes.splitlines() if re.match(r"\| (PPO|DQN)", line)]
    assert 2 <= len(timed) == recipes.count("```python")


def test_a_page_ends_with_its_own_speed():
    """Of random actions, the best heuristic and the agent, in the order of results/speed.csv."""
    last = page("wavegym/SectorSetup-v0").rpartition("## Speed")[2].splitlines()
    rows = [[cell.strip() for cell in line.split("|")[1:4]] for line in last if line.startswith("| Sector")]
    own = [speed for speed in read() if speed.environment == "SectorSetup" and speed.batch == 1]
    assert rows == [["SectorSetup", speed.actions, f"{speed.per_second:,.0f}"] for speed in own]
    assert [speed.actions for speed in own] == ["random", "best-simple", "trained"]


def test_a_page_without_picture_and_scores_is_what_describe_says(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "IMAGES", tmp_path)
    monkeypatch.setattr(module, "HEADROOM", tmp_path)
    monkeypatch.setattr(module, "read_speeds", list)
    assert page("wavegym/KershawEvans-v0") == describe("wavegym/KershawEvans-v0")
