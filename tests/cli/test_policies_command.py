"""``wavegym policies``: every name with its meaning, and whether the environment takes it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import wavegym
from wavegym.cli.environments import listed, why_not
from wavegym.cli.main import main
from wavegym.core.errors import InputError
from wavegym.core.worlds import tuning_tapes
from wavegym.evaluation import make_task
from wavegym.schedulers.registry import MEANINGS, SCHEDULERS, make_policy
from wavegym.systems.kershaw_evans.system import KershawEvansPosition
from wavegym.systems.multifunction_radar.system import MultifunctionRadar

LADDERS = Path(__file__).parents[2] / "results" / "headroom"


@pytest.mark.parametrize("name", ["KershawEvansPosition-v0", "RfEo-v0", "SectorSetupCity-v0", "EnergyBudgetKnown-v0"])
@pytest.mark.slow
def test_what_the_ladder_played_applies_and_its_other_heuristics_do_not(name):
    played = set(json.loads((LADDERS / f"{name}.json").read_text())["policies"])
    system = make_task(name, {}).system
    heuristics = {"weighted-myopic", "greedy", "aware-greedy", "cost-of-delay", "hold-until-detected", "constant-pace"}
    heuristics |= {"lagrangian-price", "adaptive-lagrangian-price", "clear-slot-price"}
    assert {each for each in played if why_not(each, system)} == set()
    assert {each for each in heuristics if not why_not(each, system)} == heuristics & played


def test_what_does_not_apply_cannot_be_made_either():
    system = KershawEvansPosition(horizon=3)
    tapes = tuning_tapes(system, 0)
    refused = [name for name in MEANINGS if ":" not in name and why_not(name, system)]
    assert len(refused) > 10
    for name in refused:
        with pytest.raises(InputError):
            make_policy(name, system, tapes).begin(system, 1, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("name", "system", "why"),
    [
        ("myopic:polish", KershawEvansPosition(), "needs action='box'"),
        ("myopic:polish", KershawEvansPosition(action="box"), ""),
        ("fixed:NAME", KershawEvansPosition(), "it names no constants"),
        ("lookahead:H", MultifunctionRadar(slots=8), "needs steps of one length"),
        ("best-planner", MultifunctionRadar(slots=8), "needs steps of one length"),
        ("dwell-rollout:N", MultifunctionRadar(slots=8), ""),
    ],
)
def test_the_reason_is_a_few_words(name, system, why):
    assert why_not(name, system) == why


def test_the_command_prints_a_line_for_each_policy(capsys):
    assert main(["policies", "Urban-v0"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split("  ")[-1].strip() == "applies to wavegym/Urban-v0"
    assert [line.split()[0] for line in lines[1 : len(MEANINGS) + 1]] == [*MEANINGS]
    applies = {line.split()[0]: line[lines[0].index("applies") :] for line in lines[1:] if line}
    assert applies["myopic"] == applies["open-loop"] == applies["ppo"] == "yes"
    assert applies["myopic:slsqp"] == "no: needs action='box'"


def test_a_trained_agent_needs_the_parameters_of_its_training():
    found = {name: why for name, _, why in listed(make_task("AgileClutter-v0", {}))}
    assert (found["ppo"], found["dqn"]) == ("", "needs action=joint")
    found = {name: why for name, _, why in listed(make_task("AgileClutter-v0", {"action": "joint"}))}
    assert found["dqn"] == ""
    assert "chooses among actions 72 (library for each of 2 sensors" in found["ppo"]
    assert "offers 64 (joint" in found["ppo"]
    found = {name: why for name, _, why in listed(make_task("UrbanSignal-v0", {"horizon": 3}))}
    assert found["ppo"] == "none comes with it"


def test_a_scheduler_of_a_package_is_listed():
    wavegym.register_scheduler("of-tests", lambda system, worlds: None)
    try:
        rows = {row[0]: row[1:] for row in listed(make_task("KershawEvansPosition-v0", {}))}
    finally:
        del SCHEDULERS.added["of-tests"]
    assert rows["of-tests"] == ("registered by a package", "")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["KershawEvansPositoin-v0"], "did you mean 'wavegym/KershawEvansPosition-v0'?"),
        (["KershawEvansPosition-v0", "--set", "horizn=3"], "did you mean 'horizon'?"),
    ],
)
def test_a_mistake_is_one_line(arguments, words, capsys):
    assert main(["policies", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
