from __future__ import annotations

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from delay_systems import DelaySystem, delay_worlds

from wavegym.core.errors import InputError
from wavegym.evaluation import tune_constants
from wavegym.evaluation.task import Task
from wavegym.registration import SYSTEMS
from wavegym.schedulers import registry as names
from wavegym.schedulers import rollout, tuned_constants
from wavegym.schedulers.heuristics.index_policies import AwareGreedy, CostOfDelay
from wavegym.schedulers.heuristics.price_policies import AdaptiveLagrangianPrice
from wavegym.schedulers.heuristics.registry import HEURISTICS
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
    classes = set(SYSTEMS.values())
    for name, record in tuned_constants.records().items():
        assert name in classes
        assert record["best-simple"] in record
        assert record["best-simple"] == min(record["costs"], key=record["costs"].get)
        for name in record["costs"]:
            HEURISTICS[name].make(**record[name])
        if "best-planner" in record:
            assert is_scheduler(record["best-planner"])


def test_the_command_tunes_compares_and_writes(tmp_path, monkeypatch, small_grids, capsys):
    monkeypatch.setattr(tune_constants, "make_task", lambda env_id, settings: Task(env_id, SYSTEM, None, {}))
    out = tmp_path / "tuned_constants.toml"
    out.write_text(tuned_constants.as_toml({"Another": {"best-simple": "myopic", "myopic": {}}}))
    tune_constants.main(["Delay-v0", "--worlds", "6", "--planners", "rollout:5,rollout:1", "--out", str(out)])
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
    assert re.search(f"{key}: best simple is {best}; {best} ", capsys.readouterr().out)


def test_every_heuristic_and_planner_is_a_name():
    heuristics = {
        "lagrangian-price",
        "adaptive-lagrangian-price",
        "constant-pace",
        "cycle",
        "greedy",
        "aware-greedy",
        "gain:L",
        "cost-of-delay",
        "hold-until-detected",
    }
    planners = {
        "plan-once",
        "rollout:H",
        "receding-horizon",
        "beam:W",
        "mcts:N",
        "tree:H",
        "best-simple",
        "best-planner",
    }
    assert set(names.FORMS) >= heuristics | planners
