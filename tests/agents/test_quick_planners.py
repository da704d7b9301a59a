"""Planners of 10 ms: which one is chosen, and PPO's cost against it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents import leaderboard, quick_planners
from wavegym.evaluation import compare
from wavegym.evaluation.planner_sweep import Setting, Swept, as_csv
from wavegym.evaluation.report import compressed
from wavegym.schedulers import Fixed, Lookahead, Myopic

NAME, ID = "KershawEvansPosition", "wavegym/KershawEvansPosition-v0"


def swept(planner: str, base: str, log_ratio: float, ms: float) -> Swept:
    return Swept(Setting(planner, base, {}), 8, log_ratio, 0.0, ms)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a sweep, and with empty places for the ladder and the episodes."""
    for name in ("SWEEPS", "HEADROOM", "LEADERBOARD"):
        (tmp_path / name).mkdir()
        monkeypatch.setattr(leaderboard if name == "HEADROOM" else quick_planners, name, tmp_path / name)
    monkeypatch.setattr(quick_planners, "WORLDS", 4)
    monkeypatch.setattr(quick_planners, "PAGE", tmp_path / "page.md")
    (tmp_path / "page.md").write_text(f"before\n{quick_planners.START}\n{quick_planners.END}\nafter\n")
    rows = [
        swept("", "myopic", -9.0, 0.1),
        swept("lookahead:2", "", -0.2, 9.0),
        swept("rollout:2", "myopic", -0.1, 1.0),
        swept("lookahead:3", "", -0.4, 11.0),
    ]
    (tmp_path / "SWEEPS" / f"{NAME}-v0.csv").write_text(as_csv(rows))
    return tmp_path


def test_the_planner_is_the_best_within_the_limit_and_no_rule(folder: Path) -> None:
    assert quick_planners.quick_planner(NAME).setting == Setting("lookahead:2", "", {})


def test_the_costs_are_those_of_the_planner(folder: Path) -> None:
    quick_planners.play(NAME, jobs=1)
    policies = {"best-simple": Myopic(), "ppo": Fixed(0), "planner": Lookahead(2)}
    again = compare(ID, policies, worlds=4, jobs=1, progress=False)
    for file in (f"LEADERBOARD/{NAME}-ppo.csv.xz", f"HEADROOM/{NAME}-v0.csv.xz"):
        (folder / file).write_bytes(compressed(again.by_policy()))
    quick_planners.renew([NAME])
    (row,) = [line for line in (folder / "page.md").read_text().splitlines() if line.startswith(f"| {NAME}")]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[1:3] == ["`lookahead:2`", "9.0"]
    logs = {name: np.log(again.cost(name)) for name in policies}
    for cell, (name, reference) in {3: ("planner", "best-simple"), 5: ("ppo", "planner")}.items():
        expected = 100.0 * np.expm1((logs[name] - logs[reference]).mean())
        assert float(cells[cell]) == pytest.approx(expected, rel=0.05)
