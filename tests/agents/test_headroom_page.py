"""The page of headroom shows the figures of the ladder."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from agents import headroom_page
from wavegym.core.errors import InputError
from wavegym.evaluation import headroom, planner_sweep
from wavegym.evaluation.comparison import Comparison
from wavegym.evaluation.play import Played

pytestmark = pytest.mark.usefixtures("delay_environment")
DELAY = "tests/Delay-v0"


def played(costs, errors=None):
    """A record of costs (world, H), of position errors (world,), by default as believed, and of the clock."""
    count = len(costs)
    nothing, steps = np.full(count, np.nan), np.full(count, costs.shape[1])
    return [
        Played(
            cost=costs,
            steps=steps,
            span=steps * 1.0,
            rmse=np.sqrt(costs.mean(axis=1)) if errors is None else errors,
            target_rmse=nothing[:, None],
            believed_rmse=nothing,
            gospa=nothing,
            nees_sum=np.zeros(costs.shape),
            nees_count=np.zeros(costs.shape, int),
            lost=nothing,
            collisions=nothing,
            share=nothing,
            choice=np.zeros((*costs.shape, 0), int),
            options=np.zeros(count, int),
            seconds=steps * 1e-6,
            outside=nothing,
        )
    ]


def comparison_of(costs):
    task = headroom.make_task(DELAY, {})
    return Comparison(task, 0, list(range(50)), {name: played(value) for name, value in costs.items()})


def test_figures_are_paired_with_the_best_simple_rule():
    rng = np.random.default_rng(0)
    simple = np.exp(rng.normal(size=(50, 6)))
    found = headroom.figures(
        comparison_of({"best-simple": simple, "best-planner": 0.8 * simple, "plan-once": 0.9 * simple})
    )
    rows = found["policies"]
    assert rows["best-planner"]["vs_simple_percent"] == pytest.approx(-20.0)
    np.testing.assert_allclose(rows["best-planner"]["vs_simple_ci"], -20.0)
    assert rows["best-simple"]["mean"] == pytest.approx(simple.mean())
    assert rows["plan-once"]["us_per_decision"] == pytest.approx(1.0)
    text = headroom_page.block([json.loads(json.dumps(found))])
    share = 100 * np.log(0.9) / np.log(0.8)
    assert f"A plan made once recovers {share:.0f} % of the planner's gain." in text
    assert re.search(r"^\| Delay-v0 +\|", text, re.MULTILINE)
    assert text.count("-20.0") >= 6  # overview, ladder, intervals, by belief and by truth
    assert [rows["best-planner"]["truth"][key] for key in ("mean", "geometric_percent")] == pytest.approx(
        [0.8 * simple.mean(), -20.0]
    )
    assert "Error by truth, of the position:" in text
    assert "NEES" not in text  # nothing of it was recorded
    assert text.count("\n\n## ") == 1


def test_the_overview_shows_the_consistency_where_it_is_measured():
    names = ("random", "best-simple", "myopic", "best-planner")
    found = json.loads(json.dumps(headroom.figures(comparison_of(dict.fromkeys(names, np.ones((50, 6)))))))
    assert "true over believed" not in headroom_page.overview([found])
    nees, over = ({name: 10.0 * k + n for n, name in enumerate(names)} for k in (1, 2))
    for name in names:
        found["policies"][name] |= {
            "nees": {"mean": nees[name], "ci": [4.1, 99.0] if name == "myopic" else [0.0, 99.0]},
            "true_over_believed": {"ratio": over[name], "ci": [1.1, 99.0] if name == "random" else [0.0, 99.0]},
        }
    text = headroom_page.overview([found, {**found, "nees_dimension": 4}])
    (line,) = re.findall(r"^\| Delay-v0 +\| +4 \|.*", text, re.MULTILINE)
    assert line.replace(" ", "").endswith("|4|10.00|20.00high|11.00|21.00|12.00high|22.00|13.00|23.00|")


def test_the_page_names_policies_whose_order_is_another_by_truth():
    rng = np.random.default_rng(0)
    costs = {name: rng.lognormal(0.0, 0.3, (50, 6)) for name in ("best-simple", "best-planner")}
    comparison = comparison_of(costs)
    for factor, named in ((1.0, False), (2.0, True)):
        errors = factor * np.sqrt(costs["best-simple"].mean(axis=1))
        flattered = {**comparison.played, "best-planner": played(0.5 * costs["best-planner"], errors)}
        text = headroom_page.block([json.loads(json.dumps(headroom.figures(replace(comparison, played=flattered))))])
        assert ("best-simple against best-planner +" in text) == named
        assert ("Wherever both differences are significant" in text) != named


def test_results_of_an_earlier_version_are_to_be_played_again(tmp_path, capsys):
    found = headroom.figures(comparison_of({name: np.ones((50, 6)) for name in ("best-simple", "best-planner")}))
    found.pop("reversals")
    (tmp_path / "CameraSlew-v0.json").write_text(json.dumps(found))
    (tmp_path / "page.md").write_text("")
    assert headroom_page.main([str(tmp_path), str(tmp_path / "page.md"), str(tmp_path)]) == 2
    assert "has no figures by truth, expected it from `make headroom IDS=CameraSlew-v0`" in capsys.readouterr().err


def test_a_plan_that_loses_recovers_nothing():
    simple = np.ones((50, 6)) + np.arange(50)[:, None]
    costs = {"best-simple": simple, "best-planner": 0.9 * simple, "plan-once": 1.1 * simple}
    text = headroom_page.block([json.loads(json.dumps(headroom.figures(comparison_of(costs))))])
    assert "A plan made once recovers nothing of the planner's gain." in text


def test_the_page_keeps_what_is_written_by_hand():
    page = f"before\n{headroom_page.START}\nold\n{headroom_page.END}\nafter\n"
    fresh = headroom_page.renewed(page, [])
    assert fresh.startswith("before\n")
    assert fresh.endswith("\nafter\n")
    assert "old" not in fresh
    with pytest.raises(InputError, match="has no lines"):
        headroom_page.renewed("nothing", [])


def test_the_page_shows_what_time_buys(tmp_path):
    """In a sweep a rule is the best within 1 ms, and a planner above: the page names both with their costs."""
    header = ",".join(planner_sweep.COLUMNS)
    rule, planner = ",greedy,,,,8,0.000,0.000,0.01,1,", "rollout:5,greedy,5,4,,8,-12.34,1.26,7.0,10;100;unlimited,"
    (tmp_path / "CameraSlew-v0.csv").write_text("\n".join([header, rule, planner]) + "\n")
    page = tmp_path / "page.md"
    page.write_text(f"{headroom_page.START}\n{headroom_page.END}\n")
    assert headroom_page.main([str(tmp_path / "none"), str(page), str(tmp_path)]) == 0
    (line,) = [line for line in page.read_text().splitlines() if line.startswith("| CameraSlew-v0")]
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells == ["CameraSlew-v0", "`greedy` 0", *["`rollout:5@greedy` -12.3 ± 1.3"] * 3]
