from __future__ import annotations

import csv
import importlib
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from delay_systems import DelaySystem, delay_worlds

from wavegym.core.errors import InputError
from wavegym.evaluation import planner_sweep, tune_constants
from wavegym.evaluation.play import Task
from wavegym.registration import SYSTEMS
from wavegym.schedulers import rollout, tuned_constants
from wavegym.schedulers.heuristics.grids import BAND_RULES, HEURISTICS, TIMELINE
from wavegym.schedulers.heuristics.index_policies import AwareGreedy, CostOfDelay
from wavegym.schedulers.heuristics.price_policies import AdaptiveLagrangianPrice
from wavegym.schedulers.heuristics.rule_features import RuleFeatures
from wavegym.schedulers.registry import is_scheduler, make_policy

SYSTEM = DelaySystem()
RECORD = {
    "delay_systems:DelaySystem": {
        "best-simple": "aware-greedy",
        "best-planner": "rollout:3",
        "aware-greedy": {"kappa": 0.7, "ahead": 5},
        "cycle": {"actions": [0, 0, 2]},
        "costs": {"aware-greedy": 12.5},
    }
}


@pytest.fixture
def recorded(monkeypatch):
    monkeypatch.setattr(tuned_constants, "records", lambda: RECORD)


@pytest.fixture
def small_grids(monkeypatch):
    for name, family in HEURISTICS.items():
        grid = {constant: (family.start[constant],) for constant in family.grid}
        monkeypatch.setitem(HEURISTICS, name, replace(family, grid=grid))


def test_recorded_constants_are_used_without_any_world(recorded):
    policy = make_policy("aware-greedy", SYSTEM, None)
    assert isinstance(policy, AwareGreedy)
    assert (policy.kappa, policy.ahead) == (0.7, 5)
    assert make_policy("cycle", SYSTEM, None).policy.actions.tolist() == [0, 0, 2]
    best = make_policy("best-simple", SYSTEM, None)
    assert isinstance(best, AwareGreedy)
    assert best.kappa == 0.7


def test_other_parameters_than_the_recorded_ones_are_tuned_on_the_spot(recorded, small_grids):
    system = DelaySystem(setup=1)
    assert tuned_constants.recorded(system) == {}
    policy = make_policy("aware-greedy", system, delay_worlds(system, 4))
    assert (policy.kappa, policy.ahead) == tuple(HEURISTICS["aware-greedy"].start.values())


def test_heuristics_without_a_record_are_tuned_on_the_spot(recorded, small_grids):
    assert isinstance(make_policy("cost-of-delay", SYSTEM, delay_worlds(SYSTEM, 4)), CostOfDelay)
    assert isinstance(
        make_policy("adaptive-lagrangian-price", SYSTEM, delay_worlds(SYSTEM, 4)), AdaptiveLagrangianPrice
    )


@pytest.mark.parametrize(
    "name", ["best-planner", "rollout:3", "tree:2", "beam:3", "mcts:4", "receding-horizon", "plan-once"]
)
def test_planners_follow_the_best_heuristic(recorded, name):
    system = SYSTEM
    policy = make_policy(name, system, None)
    assert is_scheduler(name)
    assert any(isinstance(part, AwareGreedy) for part in _parts(policy))
    if name == "best-planner":
        assert type(policy) is type(make_policy("rollout:3", system, None))
        assert policy.futures.depth == 3


def _parts(policy):
    """The values of the policy's fields, and of its fields' fields."""
    for part in vars(policy).values():
        yield part
        yield from vars(part).values() if hasattr(part, "__dict__") else ()


@pytest.mark.parametrize("name", ["rollout:0", "beam:-1", "mcts:x", "rollout", "tree:1.5", "gain:0", "gain:x"])
def test_numbers_out_of_range_are_told_in_one_line(recorded, name):
    with pytest.raises(InputError) as error:
        make_policy(name, SYSTEM, None)
    assert "\n" not in str(error.value)


def test_the_file_reads_as_it_was_written():
    table = {
        **RECORD,
        "Another": {
            "best-simple": "cycle",
            "gain": {"ahead": 3},
            "receding-horizon": {"asks": False},
            "cycle": {"actions": [[0.5, -1.0]]},
        },
    }
    assert tomllib.loads(tuned_constants.as_toml(table)) == table


def test_the_packaged_records_make_the_heuristics_that_they_name():
    classes = {record.system for record in SYSTEMS.values()}
    for name, record in tuned_constants.records().items():
        assert name in classes
        assert record["best-simple"] in record
        assert record["best-simple"] == min(record["costs"], key=record["costs"].get)
        for name in record["costs"]:
            HEURISTICS[name].make(**record[name])
        if "best-planner" in record:
            assert is_scheduler(record["best-planner"])


@pytest.fixture
def delay_task(monkeypatch):
    monkeypatch.setattr(tune_constants, "make_task", lambda env_id, settings: Task(env_id, SYSTEM, None, {}))


def test_the_packaged_rules_are_for_the_features_that_the_systems_have():
    found = {
        name: record["searched-rule"] for name, record in tuned_constants.records().items() if "searched-rule" in record
    }
    assert found
    for name, rule in found.items():
        module, _, kind = name.partition(":")
        system = getattr(importlib.import_module(module), kind)()
        assert tuple(rule["features"]) == RuleFeatures(system).names, f"{name}: {tune_constants.parser().prog} ID"


@pytest.mark.slow
def test_the_command_tunes_compares_and_writes(tmp_path, delay_task, small_grids, capsys):
    out = tmp_path / "tuned_constants.toml"
    out.write_text(tuned_constants.as_toml({"Another": {"best-simple": "myopic", "myopic": {}}}))
    few = ["--worlds", "6", "--search-worlds", "4", "--evaluations", "15"]
    tune_constants.main(["Delay-v0", *few, "--planners", "rollout:5,rollout:1", "--out", str(out)])
    table = tomllib.loads(out.read_text())
    key = tuned_constants.record_key(SYSTEM)
    record = table[key]
    assert set(table) == {"Another", key}
    ratios = record["planner_costs"]
    assert set(ratios) == {"rollout:5", "rollout:1"}
    assert record["best-planner"] == min(ratios, key=ratios.get)
    best = record["best-simple"]
    assert record["costs"][best] == min(record["costs"].values())
    worlds = tune_constants.draw_worlds(SYSTEM, tune_constants.world_seeds(0, "tune", 6))
    cost = np.exp(np.log(rollout(SYSTEM, HEURISTICS[best].make(**record[best]), worlds).mean_cost).mean())
    assert record["costs"][best] == pytest.approx(cost, rel=1e-3)
    printed = capsys.readouterr().out
    assert re.search(f"{key}: best-simple is {best}; {best} ", printed)
    assert (
        "CMA-ES has 15 evaluations on at most 4 worlds for each of clear-slot-price, searched-dwell, weighted-myopic,"
        in printed
    )
    assert re.search(r"searched-rule was found with 15 evaluations in \d+(\.\d)? CPU seconds", printed)
    assert record["searches"]["searched-rule"]["worlds"] == 4


@pytest.mark.slow
def test_the_command_searches_named_heuristics_alone_and_keeps_the_planner_as_measured(tmp_path, delay_task):
    key, out = tuned_constants.record_key(SYSTEM), tmp_path / "tuned.toml"
    before = {"best-simple": "aware-greedy", "best-planner": "rollout:3", "aware-greedy": {"kappa": 0.7, "ahead": 5}}
    slow = {
        name: dict(HEURISTICS[name].start)
        for name in HEURISTICS
        if HEURISTICS[name].grid and name not in ("aware-greedy", *BAND_RULES, *TIMELINE)
    }
    out.write_text(tuned_constants.as_toml({key: {**before, **slow, "cycle": {"actions": [0, 2]}}}))
    few = ["--worlds", "8", "--search-worlds", "8", "--evaluations", "20"]
    tune_constants.main(["Delay-v0", *few, "--heuristics", "searched-rule", "--out", str(out)])
    record = tomllib.loads(out.read_text())[key]
    assert record["aware-greedy"] == before["aware-greedy"]
    assert record["searches"].keys() >= {"searched-rule"}
    assert record["best-simple"] == min(record["costs"], key=record["costs"].get) != "aware-greedy"
    assert (record["best-planner"], record["planner-base"]) == ("rollout:3", "aware-greedy")
    tune_constants.main(["Delay-v0", *few, "--heuristics", "none", "--out", str(out)])
    assert tomllib.loads(out.read_text())[key] == record


@pytest.mark.slow
def test_the_command_sweeps_planners_and_records_the_best(tmp_path, delay_task, monkeypatch, capsys, small_grids):
    for name, values in {"DEPTHS": (2, 4), "FUTURES": (2,), "HOLDS": ((1,),), "ROUNDS": (1,), "LOOKAHEADS": ()}.items():
        monkeypatch.setattr(planner_sweep, name, values)
    out = tmp_path / "tuned.toml"
    few = ["--worlds", "6", "--search-worlds", "4", "--evaluations", "15", "--sweep-worlds", "5"]
    tune_constants.main(["Delay-v0", *few, "--sweep", "600", "--sweep-out", str(tmp_path), "--out", str(out)])
    rows = list(csv.DictReader((tmp_path / "Delay-v0.csv").open()))
    (best,) = [row for row in rows if "unlimited" in row["best_within_ms"]]
    record = tomllib.loads(out.read_text())[tuned_constants.record_key(SYSTEM)]
    assert best["worlds"] == "5"
    assert record.get("best-planner", "") == best["planner"]
    assert record.get("planner-base", record["best-simple"]) == best["base"]
    assert re.search("best within 100 ms: .* % of the best heuristic's cost", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--cpu-seconds", "5", "--evaluations", "9"], "both given, expected one"),
        (["--cpu-seconds", "0"], r"CPU seconds is 0\.0"),
        (["--evaluations", "0"], "evaluations is 0"),
        (["--search-worlds", "0"], "search-worlds is 0"),
        (["--sweep", "-1"], r"sweep is -1\.0"),
        (["--sweep-worlds", "1"], "sweep-worlds is 1"),
        (["--heuristics", "searched-rul"], "did you mean 'searched-rule'"),
        (["--import", "no_such_package"], "package is 'no_such_package'"),
    ],
)
def test_bad_options_are_told_in_one_line(tmp_path, delay_task, arguments, message):
    with pytest.raises(InputError, match=message) as error:
        tune_constants.main(["Delay-v0", *arguments, "--out", str(tmp_path / "tuned.toml")])
    assert "\n" not in str(error.value)


def test_a_rule_recorded_for_other_features_names_the_command(monkeypatch):
    stale = {"features": ["gone"], "weights": [1.0], "scales": [1.0]}
    record = {"best-simple": "searched-rule", "searched-rule": stale}
    monkeypatch.setattr(tuned_constants, "records", lambda: {"delay_systems:DelaySystem": record})
    for name in ("searched-rule", "best-simple"):
        with pytest.raises(InputError, match=r"gone.*python -m wavegym\.evaluation\.tune_constants"):
            make_policy(name, SYSTEM, None)
