"""The multifunction radar against its load: what is played and what the page shows of it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from agents import loads, loads_page
from wavegym.core.worlds import world_seeds
from wavegym.evaluation import make_task
from wavegym.evaluation.play import play
from wavegym.schedulers.heuristics.grids import HEURISTICS, TIMELINE
from wavegym.schedulers.tuned_constants import recorded
from wavegym.systems.multifunction_radar.system import MultifunctionRadar


@pytest.fixture
def brief(monkeypatch, tmp_path):
    """Episodes of 0.6 s, few decisions timed, no agents, and a folder of its own."""
    monkeypatch.setattr(loads, "make_task", lambda env_id, given: make_task(env_id, {**given, "seconds": 0.6}))
    for name, value in {"TIMED": 4, "RUNS": tmp_path / "none", "FOLDER": tmp_path}.items():
        monkeypatch.setattr(loads, name, value)
    monkeypatch.setattr(loads_page, "PAGE", tmp_path / "page.md")
    monkeypatch.setattr(loads_page, "PICTURE", tmp_path / "loads.png")
    loads_page.PAGE.write_text(f"before\n{loads_page.START}\n{loads_page.END}\nafter\n")
    return tmp_path


@pytest.mark.slow
def test_every_policy_is_played_and_its_figures_are_those_of_play(brief):
    found = loads.results_of(4, worlds=5)
    assert set(found["policies"]) == {"random", *TIMELINE}
    task = make_task(loads.ENV_ID, {"targets": 4.0, "seconds": 0.6})
    name = "van-keuk-blackman"
    rule = HEURISTICS[name].make(**recorded(MultifunctionRadar())[name])
    played = play(task, rule, world_seeds(loads.SEED, "test", 5))
    shown = found["policies"][name]
    assert shown["belief"]["value"] == pytest.approx(played.episode_cost().mean() / task.system.c0, rel=1e-12)
    assert shown["truth"]["value"] == pytest.approx((played.gospa**2).mean() / task.system.c0, rel=1e-12)
    assert found["policies"][loads_page.BASE]["against"]["value"] == 0.0
    again = loads.timed_again(found)
    assert again["policies"][name] == {**shown, "microseconds": again["policies"][name]["microseconds"]}
    assert again["policies"][name] != shown
    assert again["bound"] == found["bound"]
    assert all(policy["microseconds"] > 0.0 for policy in found["policies"].values())
    assert all(0.0 <= policy["beyond"] <= 1.0 for policy in found["policies"].values())
    assert 0.0 < found["bound"]["value"] < shown["truth"]["value"]
    others = [policy for rule, policy in found["policies"].items() if rule != name]  # it needs no update in 0.6 s
    assert all(0.0 < policy["searched"] < 1.0 for policy in others)
    for policy in found["policies"].values():
        assert sum(policy[part] for part in loads_page.COST_PARTS) == pytest.approx(1.0, rel=1e-12)
        assert policy["searched"] + policy["updated"] <= 1.0 + 1e-12
    shares = found["policies"][loads_page.BASE]
    assert 0.0 < shares["updated"] < 1.0
    least, most = found["blind"].values()
    assert 0.0 < least < most
    assert np.isfinite([policy["confirm"] for policy in found["policies"].values()]).all()


@pytest.mark.slow
@pytest.mark.usefixtures("brief")
def test_agents_are_played_again_on_the_same_worlds(monkeypatch):
    """Two runs that play as a rule does cost what it costs; the results of the rules stay as they are."""
    before = loads.results_of(4, worlds=5)
    rule = "gain-per-second"
    twins = [HEURISTICS[rule].make(**recorded(MultifunctionRadar())[rule]) for _ in range(2)]
    monkeypatch.setattr(loads, "_agents", lambda task: {"ppo": twins})
    after = loads.agents_again(before)
    assert set(after["policies"]) == {*before["policies"], "ppo"}
    assert after["policies"][rule] == before["policies"][rule]
    assert after["bound"] == before["bound"]
    for half in ("belief", "truth", "against"):
        assert after["policies"]["ppo"][half]["value"] == pytest.approx(before["policies"][rule][half]["value"])


@pytest.mark.slow
def test_the_page_has_a_table_for_each_load_one_of_planners_and_a_picture(brief, monkeypatch):
    for load in (8, 16):
        result = loads.results_of(load, worlds=3)
        (brief / f"{load}.json").write_text(json.dumps(result))
    monkeypatch.setattr(loads, "PLANNERS", ((1, 2),))
    monkeypatch.setattr(loads, "PLANNED_SECONDS", 0.6)
    monkeypatch.setattr(loads, "PLANNED_DECISIONS", 2)
    result = loads.planners_of(8)
    (brief / "planners.json").write_text(json.dumps(result))
    planned = result["policies"]
    assert list(planned) == ["searched-dwell", "dwell-rollout:1, 2 dwells"]
    assert planned["searched-dwell"]["against"]["value"] == 0.0
    monkeypatch.setattr(loads, "SHIFTS", {"a wide beam": {"beam_width": 3.0}, "far": {"reference_range": 80e3}})
    result = loads.shifts_of(8, worlds=3)
    (brief / "shifts.json").write_text(json.dumps(result))
    shifted = result["shifts"]
    assert shifted["a wide beam"]["searched-dwell"]["belief"] != shifted["far"]["searched-dwell"]["belief"]
    assert shifted["far"]["searched-dwell"]["against"]["value"] == 0.0
    loads_page.renew(brief)
    page = loads_page.PAGE.read_text()
    assert page.startswith("before\n")
    assert page.endswith("after\n")
    assert page.index("### 8 targets, 3 worlds") < page.index("### 16 targets, 3 worlds")
    assert page.count("van-keuk-blackman") == 4
    assert page.index("### Planners at 8 targets") < page.index("### Changed radars") < page.index("| far")
    assert page.count("lower bound") == 2
    assert page.count("blind search in all of the time") == 2
    assert page.index("### 16 targets, 3 worlds") < page.index("### Planners at 8 targets")
    assert loads_page.PICTURE.read_bytes().startswith(b"\x89PNG")
