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
from wavegym.core.command_line import settings
from wavegym.core.errors import InputError
from wavegym.evaluation.account import Account
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
    text = ablation.table({NAME: accounts})
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("| Small")
    ]
    assert [row[:3] for row in rows] == [["Small", "full", "1"], ["Small", "other", "1"]] * 2
    assert rows[0][5:7] == ["", ""]


def test_figures_are_geometric_means_of_paired_ratios() -> None:
    def account(*costs: float) -> Account:
        values, nothing = np.array([costs]), np.full((1, len(costs)), np.nan)
        return Account(values, values, nothing, nothing, nothing, nothing)

    played = {"best-simple": account(1.0, 4.0), "full": account(0.5, 2.0), "no-masks": account(1.0, 2.25)}
    belief, truth = (
        part.strip().splitlines()[-1].split("|") for part in ablation.table({NAME: played}).split("By truth:")
    )
    assert belief[4].strip() == "-25.0"  # sqrt(1 * 2.25 / 4) = .75
    assert belief[6].strip() == "+50.0"  # sqrt(2 * 1.125) = 1.5
    assert float(truth[4]) == pytest.approx(100 * (0.75**2 - 1), abs=0.06)  # errors in m, squared
    assert truth[6].strip() == "+125.0"


def test_runs_meet_those_of_the_same_seed() -> None:
    """An agent with the full agent's cost in each run is no better, however much its runs differ."""
    costs = np.array([[1.0, 2.0], [9.0, 4.0]])
    assert ablation.against_seed_by_seed(costs, costs).value == pytest.approx(0.0, abs=1e-12)
    assert ablation.against_seed_by_seed(2.0 * costs, costs).value == pytest.approx(100.0)
    with pytest.raises(InputError, match=r"runs and worlds are \(1, 2\), expected the full agent's \(2, 2\)"):
        ablation.against_seed_by_seed(costs[:1], costs)


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
