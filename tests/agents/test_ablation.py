"""The ablation: every agent against the full agent and against the best simple heuristic."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from runs_for_tests import ID

from agents import ablation
from agents import experiment as experiment
from agents.leaderboard import Account
from wavegym.core.command_line import settings
from wavegym.core.errors import InputError
from wavegym.learning.settings import load_settings
from wavegym.registration import SYSTEMS

ABLATIONS = {name: found for name, found in experiment.load_experiments().items() if name.endswith(ablation.SUFFIX)}
NAME = f"Small{ablation.SUFFIX}"


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unbroken: dict[str, Path]) -> experiment.Experiment:
    """An experiment with two trained agents."""
    monkeypatch.setattr(experiment, "FOLDER", tmp_path)
    monkeypatch.setattr(ablation, "FOLDER", tmp_path / "ablation")
    monkeypatch.setattr(ablation, "WORLDS", 4)
    for learner, algo in (("full", "ppo"), ("other", "dqn")):
        shutil.copytree(unbroken[algo], experiment.run_folder(NAME, learner) / "seed1")
    learners = {"full": experiment.Learner("ppo"), "other": experiment.Learner("dqn")}
    return experiment.Experiment(env=ID, seeds=(1,), learners=learners, environment=("horizon=7",))


def test_agents_are_played_on_the_same_worlds_and_set_beside_the_full_one(small: experiment.Experiment) -> None:
    ablation.play(NAME, small, jobs=1)
    accounts = ablation.read_accounts(ablation.FOLDER / f"{NAME}.csv")
    assert set(accounts) == {"myopic", "best-simple", "full", "other"}
    assert all(account.cost.shape == (1, 4) for account in accounts.values())
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in ablation.table({NAME: accounts}).splitlines()]
    assert [line[:3] for line in lines[2:]] == [["Small", "full", "1"], ["Small", "other", "1"]]
    assert lines[2][5:] == ["", ""]


def test_figures_are_geometric_means_of_paired_ratios() -> None:
    def account(*costs: float) -> Account:
        return Account(np.array([costs]), np.full((1, len(costs)), np.nan))

    played = {"best-simple": account(1.0, 4.0), "full": account(0.5, 2.0), "no-masks": account(1.0, 2.25)}
    row = ablation.table({NAME: played}).splitlines()[-1].split("|")
    assert row[4].strip() == "-25.0"  # sqrt(1 * 2.25 / 4) = .75
    assert row[6].strip() == "+50.0"  # sqrt(2 * 1.125) = 1.5


def test_runs_meet_those_of_the_same_seed() -> None:
    """An agent with the full agent's cost in each run is no better, however much its runs differ."""
    costs = np.array([[1.0, 2.0], [9.0, 4.0]])
    full = Account(costs, np.full((2, 2), np.nan))
    assert ablation.against_seed_by_seed(full, full).value == pytest.approx(0.0, abs=1e-12)
    assert ablation.against_seed_by_seed(full._replace(cost=2.0 * costs), full).value == pytest.approx(100.0)
    with pytest.raises(InputError, match=r"runs and worlds are \(1, 2\), expected the full agent's \(2, 2\)"):
        ablation.against_seed_by_seed(Account(costs[:1], np.full((1, 2), np.nan)), full)


def test_an_unknown_study_is_refused_before_any_is_trained(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["ablation", next(iter(ABLATIONS)), "CameraSlow-ablation"])
    monkeypatch.setattr(ablation, "play", lambda *_: pytest.fail("played"))
    with pytest.raises(InputError, match="did you mean 'CameraSlew-ablation'"):
        ablation.main()


@pytest.mark.parametrize("name", ABLATIONS)
def test_one_thing_at_a_time_is_left_out(name: str) -> None:
    own = ABLATIONS[name]
    assert own.env in SYSTEMS
    assert len(own.seeds) >= 3
    full = set(own.learners[ablation.FULL].set)
    for label, learner in own.learners.items():
        load_settings(own.env, learner.algo, settings(learner.set))
        lost = {pair.partition("=")[0] for pair in set(learner.set) ^ full}
        assert lost <= {"policy", "network"} or len(lost) == 1, label
        assert bool(lost) == (label != ablation.FULL), label
