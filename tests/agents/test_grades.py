"""Difficulty: values of the environment, a folder for the agents of each, and a page made of the results."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import wavegym
from agents import grades
from agents.experiment import load_experiments
from wavegym.core.errors import InputError
from wavegym.evaluation import make_task
from wavegym.registration import RECORDS, SYSTEMS, TIERS, full_id


@pytest.mark.parametrize("name", grades.GRADED)
def test_the_default_is_one_of_the_values_and_each_value_makes_an_environment(name: str) -> None:
    parameter, values = grades.GRADED[name]
    assert grades.default_of(name) in values
    for value in values:
        system = make_task(full_id(name), {parameter: value}).system
        assert getattr(system, parameter) == value
    assert set(grades.STAGES) <= set(load_experiments()[name].agents)


def test_agents_of_other_values_have_folders_of_their_own() -> None:
    folders = {grades.folder_of("CameraSlew", "ppo", value).name for value in (2, 3, 4, 6)}
    assert folders == {"ppo-targets-2", "ppo-targets-3", "ppo", "ppo-targets-6"}


def test_only_missing_agents_of_other_values_are_trained(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(grades, "train_missing", lambda name, experiment, jobs: asked.append(experiment))
    grades.train("SectorSetup", ["ppo-scratch"], 1)
    (experiment,) = asked
    assert sorted(experiment.agents) == [f"ppo-scratch-targets-{n}" for n in (2, 3, 6)]
    agent = experiment.agents["ppo-scratch-targets-2"]
    assert agent.parameters == ("targets=2",)
    assert agent.settings[-1] == f"steps={grades.STEPS}"


def test_a_table_has_a_line_for_each_value_and_leaves_out_what_was_not_trained() -> None:
    found = {"percent": -11.0, "ci": [-14.0, -8.0]}
    figures = {"2": {"myopic": {"belief": found}}, "4": {"ppo": {"belief": found}}}
    lines = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in grades.table("CameraSlew", figures, "belief").splitlines()
    ]
    assert lines[0][0] == "targets"
    assert lines[2][:4] == ["2", "-11.0", "-14.0 to -8.0", ""]
    assert lines[3][-2:] == ["-11.0", "-14.0 to -8.0"]


def test_the_page_is_that_of_the_results_on_file() -> None:
    page = grades.PAGE.read_text()
    for name in grades.GRADED:
        file: Path = grades.FOLDER / f"{name}.json"
        if file.exists():
            assert grades.table(name, json.loads(file.read_text()), "belief") in page


def test_every_environment_of_the_suite_has_a_tier_and_another_tier_is_refused() -> None:
    assert {record.tier for record in SYSTEMS.values()} == set(TIERS)
    with pytest.raises(InputError, match=r"tier is 'benchmrk', expected one of .*did you mean 'benchmark'"):
        wavegym.register("tests/Tier-v0", SYSTEMS["wavegym/KershawEvans-v0"].system, tier="benchmrk")
    assert "tests/Tier-v0" not in RECORDS
