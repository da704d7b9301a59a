from __future__ import annotations

import csv
import io
import json

import numpy as np
import pytest
from delay_systems import DelaySystem, delay_worlds

from wavegym.core.errors import InputError
from wavegym.evaluation import planner_sweep
from wavegym.evaluation.planner_sweep import (
    SKIPPED,
    Setting,
    Swept,
    as_csv,
    best_by_limit,
    best_within,
    read_sweep,
    settings_to_sweep,
    sweep,
)
from wavegym.schedulers import RandomChoice, rollout
from wavegym.schedulers.heuristics.index_policies import AwareGreedy, Greedy
from wavegym.schedulers.registry import planner_builder

SYSTEM = DelaySystem(horizon=8)
BASES = {"aware-greedy": AwareGreedy(0.4, 4), "greedy": Greedy(4)}


@pytest.fixture
def small(monkeypatch):
    for name, values in {
        "DEPTHS": (2, 4),
        "FUTURES": (2,),
        "HOLDS": ((1,),),
        "ROUNDS": (1,),
        "LOOKAHEADS": (2,),
    }.items():
        monkeypatch.setattr(planner_sweep, name, values)


def test_the_settings_go_over_depth_futures_and_base():
    listed = settings_to_sweep(DelaySystem(horizon=60), list(BASES))
    rollouts = [s for s in listed if s.planner.startswith("rollout")]
    assert {s.depth for s in rollouts} == {5, 10, 20, 40}
    assert {s.settings["futures"] for s in rollouts} == {4, 16, 32, 64}
    assert all(s.settings.get("errors", 1.0) == (2.0 if s.settings["futures"] == 64 else 1.0) for s in rollouts)
    assert {s.base for s in rollouts} == set(BASES)
    assert {tuple(s.settings["holds"]) for s in rollouts} == {(1,), (1, 4)}
    families = {s.planner.partition(":")[0] for s in listed}
    assert families == {"rollout", "receding-horizon", "lookahead", "plan-once"}
    works = [s.work for s in listed]
    assert works == sorted(works)
    mine = Setting("tree:2", "greedy", {})
    assert settings_to_sweep(SYSTEM, list(BASES), [mine])[0] is mine


@pytest.mark.slow
def test_a_row_is_the_geometric_mean_of_paired_ratios(small):
    worlds = delay_worlds(SYSTEM, 6)
    rows = sweep(SYSTEM, BASES, worlds, 600.0, progress=False)
    assert [row.setting.base for row in rows[:2]] == list(BASES)
    assert rows[0].log_ratio == 0.0
    row = next(row for row in rows if row.setting.planner == "rollout:4" and row.setting.base == "greedy")
    planner = planner_builder("rollout:4")(Greedy(4), holds=(1,), futures=2)
    logs = np.log(rollout(SYSTEM, planner, worlds).mean_cost) - np.log(
        rollout(SYSTEM, BASES["aware-greedy"], worlds).mean_cost
    )
    assert row.log_ratio == pytest.approx(logs.mean(), rel=1e-12)
    assert row.error == pytest.approx(logs.std(ddof=1) / np.sqrt(6), rel=1e-12)
    assert all(row.cpu_ms > 0.0 for row in rows)


def test_nothing_is_played_beyond_the_budget_and_the_file_says_so(small):
    rows = sweep(SYSTEM, BASES, delay_worlds(SYSTEM, 4), 1e-9, progress=False)
    assert [row.note for row in rows[:2]] == ["", ""]
    assert {row.note for row in rows[2:]} == {SKIPPED}
    assert SKIPPED in as_csv(rows)


def row(log_ratio, ms, planner="rollout:5"):
    return Swept(Setting(planner, "greedy", {"futures": 4}), 8, log_ratio, 0.01, ms)


def test_the_best_within_each_limit_is_marked():
    rows = [row(0.0, 0.01, ""), row(-0.1, 5.0), row(-0.2, 50.0), row(-0.15, 500.0), row(np.nan, np.nan)]
    assert best_within(rows, 1.0) is rows[0]
    assert best_within(rows, 10.0) is rows[1]
    assert best_within(rows, 100.0) is best_within(rows, np.inf) is rows[2]
    lines = list(csv.DictReader(io.StringIO(as_csv(rows))))
    assert [line["best_within_ms"] for line in lines] == ["1", "10", "100;unlimited", "", ""]
    assert {limit: best["cpu_ms_per_decision"] for limit, best in best_by_limit(as_csv(rows)).items()} == {
        "1": "0.01",
        "10": "5",
        "100": "50",
        "unlimited": "50",
    }
    assert float(lines[2]["cost_vs_best_simple_percent"]) == pytest.approx(100 * np.expm1(-0.2), abs=1e-3)
    assert json.loads(lines[2]["settings"]) == {"futures": 4}
    with pytest.raises(InputError, match=r"limit is 0.001 ms, expected at least 0.01 ms"):
        best_within(rows, 0.001)


def test_a_file_gives_the_rows_that_were_played():
    rows = [
        row(0.0, 0.25, ""),
        row(-0.125, 5.0),
        Swept(Setting("lookahead:2", "", {}), 0, np.nan, np.nan, np.nan, SKIPPED),
    ]
    played = read_sweep(as_csv(rows))
    assert [found.setting for found in played] == [row.setting for row in rows[:2]]
    assert [found.cpu_ms for found in played] == [0.25, 5.0]
    assert [found.log_ratio for found in played] == pytest.approx(
        [0.0, -0.125], abs=1e-5
    )  # percent with three decimals
    assert [(found.worlds, found.error) for found in played] == [(8, 0.01)] * 2


def test_only_decisions_are_timed():
    timed = planner_sweep.Timed(RandomChoice())
    rollout(SYSTEM, timed, delay_worlds(SYSTEM, 5))
    assert timed.decisions == 5 * SYSTEM.horizon
    assert 0.0 <= timed.seconds < 1.0
