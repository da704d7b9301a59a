"""Stages of learning: which runs are which stage follows from their settings, and the figures from the episodes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from runs_for_tests import ID

from agents import leaderboard, stages
from wavegym.evaluation import compare
from wavegym.evaluation.report import compressed
from wavegym.schedulers import Myopic

NAME = "KershawEvansPosition"


def changed(folder: Path, **settings: object) -> None:
    """Change the settings in a run's record."""
    file = folder / "run.json"
    run = json.loads(file.read_text())
    run["settings"] |= settings
    file.write_text(json.dumps(run))


@pytest.fixture
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unbroken: dict[str, Path]) -> Path:
    """The saved agent is PPO from scratch; other agents are of imitation and of both; no DQN; a ladder."""
    for agent in ("ppo", "ppo-both", "ppo-imitation"):
        shutil.copytree(unbroken["ppo"], tmp_path / "runs" / NAME / agent / "seed0")
    changed(tmp_path / "runs" / NAME / "ppo-both" / "seed0", teacher="myopic", steps=2000)
    for name, folder in {"SAVED": "runs", "HEADROOM": "headroom", "LEADERBOARD": "leaderboard"}.items():
        (tmp_path / folder).mkdir(exist_ok=True)
        monkeypatch.setattr(leaderboard if name == "HEADROOM" else stages, name, tmp_path / folder)
    monkeypatch.setattr(stages, "WORLDS", 4)
    monkeypatch.setattr(stages, "environment_of", lambda folder: {"horizon": 7})
    (tmp_path / "PAGE").write_text(f"before\n{stages.START}\n{stages.END}\nafter\n")
    monkeypatch.setattr(stages, "PAGE", tmp_path / "PAGE")
    ladder = compare(ID, {"best-simple": Myopic()}, worlds=4, jobs=1, progress=False, horizon=7)
    (tmp_path / "headroom" / f"{NAME}-v0.csv.xz").write_bytes(compressed(ladder.by_policy()))
    return tmp_path


@pytest.mark.parametrize(
    ("settings", "stage"),
    [
        ({"teacher": "", "steps": 10}, "scratch"),
        ({"teacher": "myopic", "steps": 640}, "imitation"),
        ({"teacher": "myopic", "steps": 64_000}, "both"),
    ],
)
def test_the_settings_say_which_stage_an_agent_is(folders: Path, settings: dict[str, object], stage: str) -> None:
    folder = folders / "runs" / NAME / "ppo"
    changed(folder / "seed0", **settings)
    assert stages.stage_of(folder) == stage
    assert stages.agent(NAME, "ppo", stage) in ("ppo", f"ppo-{stage}")


def test_each_stage_is_compared_with_the_best_simple_rule(folders: Path) -> None:
    assert stages.agent(NAME, "ppo", "scratch") == "ppo"
    stages.play(NAME, jobs=1)
    files = {file.name for file in (folders / "leaderboard").iterdir()}
    assert files == {
        f"{NAME}-ppo-both.csv.xz",
        f"{NAME}-ppo-imitation.csv.xz",
    }  # not the saved agent's
    again = compare(ID, {"ppo": folders / "runs" / NAME / "ppo-both"}, worlds=4, jobs=1, progress=False, horizon=7)
    simple = compare(ID, {"best-simple": Myopic()}, worlds=4, jobs=1, progress=False, horizon=7).cost("best-simple")
    percent = 100.0 * np.expm1(np.log(again.cost("ppo") / simple).mean())
    stages.renew([NAME])
    (row,) = [line for line in (folders / "PAGE").read_text().splitlines() if line.startswith(f"| {NAME}")][:1]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert float(cells[5]) == pytest.approx(percent, rel=0.05)
    assert cells[1] == ""  # the saved agent was not played
    assert cells[-1] == "-, 1, 1"
