"""The search for settings: its tuning worlds, its continuation, its table and its best trial."""

from __future__ import annotations

import csv
import tomllib
from pathlib import Path
from typing import Any

import pytest
from runs_for_tests import ID, SMALL

import train
from wavegym.core.errors import InputError
from wavegym.learning import hyperparameters as tuning
from wavegym.learning.settings import load_settings

pytest.importorskip("optuna")


@pytest.fixture
def untuned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trials are compared with a scheduler that has no constants to tune."""
    monkeypatch.setattr(tuning, "SIMPLE", "myopic")


def search(out: Path, trials: int, **changes: Any) -> str:
    return tuning.tune(ID, "ppo", trials, 0, {**SMALL["ppo"], **changes}, {"horizon": 7}, out)


@pytest.mark.slow
def test_trials_are_kept_and_the_best_is_a_settings_table(tmp_path: Path, untuned: None) -> None:
    search(tmp_path, 1)
    best = search(tmp_path, 3)
    rows = list(csv.DictReader((tmp_path / "trials.csv").open()))
    assert [row["trial"] for row in rows] == ["0", "1", "2"]
    assert "n_steps" not in rows[0]  # it was held fixed
    assert (tmp_path / "best.toml").read_text() == best
    table = tomllib.loads(best)[ID]["ppo"]
    winner = min(rows, key=lambda row: float(row["log_ratio"]))
    assert table["gamma"] == float(winner["gamma"])
    assert load_settings(ID, "ppo", {**SMALL["ppo"], **table}).gamma == table["gamma"]
    before = (tmp_path / "trials.csv").read_text()
    assert search(tmp_path, 2) == best  # there are enough
    assert (tmp_path / "trials.csv").read_text() == before


def test_test_worlds_are_never_met(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, untuned: None) -> None:
    asked = []

    def spy(seed: int, split: str, count: int) -> list[int]:
        asked.append(split)
        return [seed * 1000 + i for i in range(3)]

    monkeypatch.setattr(tuning, "world_seeds", spy)
    search(tmp_path, 1)
    assert set(asked) == {"tune"}


def test_mistakes_are_one_line_and_leave_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="tune is 0, expected"):
        search(tmp_path / "none", 0)
    out = tmp_path / "run"
    assert train.main([ID, "--algo", "ppo", "--tune", "1", "--setting", "gama=1", "--out", str(out)]) == 2
    assert "did you mean 'gamma'" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.slow
def test_the_command_prints_the_best(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fixed = [f"{key}={value}" for key, value in SMALL["dqn"].items()]
    command = [
        ID,
        "--algo",
        "dqn",
        "--tune",
        "1",
        "--out",
        str(tmp_path),
        "--setting",
        *fixed,
        "--set",
        "horizon=7",
    ]
    assert train.main(command) == 0
    assert f'["{ID}".dqn]' in capsys.readouterr().out
